"""Schedules of a chain: which steps come next. The plain one, regions round returns left in doubt, temperature ladders.

**Regions.** Once a map stands, every second turn of a chain is spent in a region round a target
(:mod:`prf.sampler.aims`), drawn without a look at the map. The moves are confined to it for a number of steps
(:mod:`prf.kernels.state.frozen`): given what lies outside they sample what lies inside, so that each leaves the
posterior what it is.

**Parallel tempering.** Beside a chain hot ones run, on which the likelihood counts less, and maps are swapped.
Chain k of the temperature ladder has the target h exp(powers[k] (log likelihood - cost * occupied sensors)), where
powers[k] is its inverse temperature; on the cold chain, of power 1, no sensor may be in black. A swap exchanges the
maps of neighbours and is accepted with probability

    min(1, exp((powers[k] - powers[k + 1]) (E(map of k + 1) - E(map of k)))),    E = log likelihood - cost * occupied,

except that a map with an occupied sensor never enters the cold chain. A chain of power 0 makes no steps: for a swap it
has a fresh, exact draw of the prior. Swaps alternate between even and odd pairs of neighbours, which carries maps
through the ladder faster than random pairs do, and the powers are moved until all pairs refuse alike (Syed,
Bouchard-Cote, Deligiannidis, Doucet 2022, Non-reversible parallel tempering).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.state.frozen import confine, release
from prf.kernels.state.targets import NEAR
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.layout import grow, read_coloring
from prf.sampler.directions import redraw_directions
from prf.sampler.target import (
    Target,
    exchanged,
    occupied_cost,
    repaint,
    run_chain,
    settle_image,
    with_map,
    without_image,
)

WHOLE = 500_000
"""Steps on the whole window before the first region: while walls are missing everywhere, regions hold a chain back."""
TURN = 2000
"""Steps in one region, or between two on the whole window."""
TURNS = 2
"""Turns in a cycle: one on the whole window, the others in a region each."""
MARGIN = 4
"""Squares of targets by which a region reaches beyond those near its middle."""
LEFT_OUT = (*c.BORDER_MOVES, c.CUT_WALL, c.MEND_WALL)
"""Moves that are not made in a region: those on the window's border, and those that need the length of all edges."""

Steps = Callable[[Chain, np.random.Generator, int], Chain]
"""Run a chain up to a step, and return it."""


class Plain:
    """The schedule of a chain that makes all its steps on the whole window; the others derive from it.

    A schedule is asked turn by turn which steps come next, by the step alone.
    """

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return how the next steps are made and up to which step: `stop` at most, or `end`, that of the round.

        At `stop` there is something to record, which only a schedule that records by itself may pass.
        """
        return run_chain, stop

    def round_length(self, step: int, block: int) -> int:
        """Return the steps of the round that begins at `step`; `block`: those that the readings ask for."""
        return block

    def begin(self, chain: Chain) -> None:
        """Before the first step, when the chain has found its start."""

    def adapt(self, step: int) -> bool:
        """At the start of a round: change what proposals or temperatures are; return whether burn-in starts again."""
        return False

    def settle(self) -> None:
        """At the end of a round: recompute sums and lists of all further chains."""


class Regions(Plain):
    """Turns on the whole window and in regions round targets; no regions at first, unless the map stands already."""

    def __init__(self, chain: Chain, stands: bool = False) -> None:
        self.whole_until = 0 if stands else WHOLE
        self.half = (NEAR + MARGIN) * chain.targets.grid.cell
        self._move_probabilities = chain.move_probabilities.copy()
        self._move_probabilities[list(LEFT_OUT)] = 0.0
        self._move_probabilities /= self._move_probabilities.sum()

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return the turn on the window, or in a region, that `step` belongs to."""
        if step < self.whole_until:
            return run_chain, min(stop, self.whole_until)
        turn = step // TURN
        return run_chain if turn % TURNS == 0 else self.run_in_region, min(stop, (turn + 1) * TURN)

    def run_in_region(self, chain: Chain, rng: np.random.Generator, step: int, target: int | None = None) -> Chain:
        """Run a chain up to `step` in the region round a target, drawn unless given; return it."""
        if target is None:
            target = int(np.searchsorted(chain.targets.cumulative, rng.random(), side="right"))
        tuning = self.tuning(chain, target)
        while True:
            frozen = np.empty(len(chain.graph.edge_length), np.int32)
            n = confine(chain.graph, tuning, frozen)
            done = run(chain._replace(tuning=tuning, move_probabilities=self._move_probabilities), rng, step)
            release(chain.graph, frozen, n)
            if done:
                return chain
            chain = grow(chain)

    def tuning(self, chain: Chain, target: int) -> NDArray[np.float64]:
        """Return the tuning of a chain in the region round a target."""
        grid, cell = chain.targets.grid, int(chain.targets.cell[target])
        x = grid.x0 + (cell % grid.nx + 0.5) * grid.cell
        y = grid.y0 + (cell // grid.nx + 0.5) * grid.cell
        tuning = chain.tuning.copy()
        tuning[c.REGION : c.REGION + 4] = x - self.half, y - self.half, x + self.half, y + self.half
        tuning[c.REGION_TARGET] = target
        tuning[c.AIMED_SHARE] = 1.0
        return tuning


def has_regions(target: Target, chain: Chain) -> bool:
    """Return whether a chain steps in regions: with a laser, whose returns are the targets, but not in tiles."""
    return (
        target.walls is None and target.laser is not None and len(chain.targets.cell) > 0 and not target.execution.tiles
    )


Floats = NDArray[np.float64]

FIRST_RATIO = 0.9
"""Ratio of neighbouring powers before anything is measured, where the ladder finds its own reach."""
FIRST_DECADES = 3.0
"""Decades that the positive powers of a full ladder span before anything is measured."""
WANTED_REFUSAL = 0.5
"""Share of swaps to be refused, where the ladder finds its own reach: about the best for so many chains."""
MOST_STRETCH = 2.0
"""The logarithm of the lowest power changes by no more than this factor at a time."""
LOWEST_REACH = 1e-3
HIGHEST_REACH = 0.98
"""Bounds of the lowest power of a ladder that finds its own reach."""
AUTO_TEMPERATURES = 6
"""Temperatures of chains that were found to disagree, where no number is given."""
LEAST_REFUSAL = 0.01
"""Share of swaps that a pair is taken to refuse at least: pairs that never refuse still keep a distance."""
SWAP_SPACING = 1000
"""Steps of every chain between two tries to swap."""
ADAPTATIONS = tuple(20_000 * 2**k for k in range(6))
"""Steps after which the powers are moved, and the burn-in starts again; after the last they are kept."""


class LadderPlan(NamedTuple):
    """The temperature ladder of each chain; :class:`prf.configuration.ChainOptions` checks it."""

    temperatures: int = 1  # the cold one among them; 1: no ladder
    lowest: float | None = None  # inverse temperature; 0: exact draws of the prior; None: half of all swaps accepted
    cost: float | None = None  # nats of log likelihood that an occupied sensor costs below power 1; None: chosen
    waits: bool = False  # temper only once chains disagree

    def first_powers(self) -> Floats:
        """Return the powers (n,) before anything is measured: evenly spaced logarithms, and 0 if it is the lowest."""
        n = self.temperatures
        if self.lowest is None:
            return FIRST_RATIO ** np.arange(n, dtype=np.float64)
        if self.lowest > 0.0:
            return np.geomspace(1.0, self.lowest, n)
        lowest_positive = 10.0 ** (-FIRST_DECADES * (n - 2) / max(n - 1, 1))
        return np.append(np.geomspace(1.0, lowest_positive, n - 1), 0.0)


def stretched_powers(powers: Floats, refusal: float) -> Floats:
    """Return powers that reach so far down, or up, that :data:`WANTED_REFUSAL` is expected instead of `refusal`."""
    factor = min(max(WANTED_REFUSAL / max(refusal, LEAST_REFUSAL), 1.0 / MOST_STRETCH), MOST_STRETCH)
    lowest = min(max(powers[-1] ** factor, LOWEST_REACH), HIGHEST_REACH)
    stretched: Floats = powers ** (math.log(lowest) / math.log(powers[-1]))
    return stretched


def even_powers(powers: Floats, refusals: Floats) -> Floats:
    """Return powers with the same ends between which swaps should be refused equally often.

    The communication barrier between two powers is the sum of the refusals between them (Syed et al., section 5). It is
    taken to grow evenly with the logarithm of the power, and towards 0 with the power itself.

    `powers` (n,), `refusals` (n - 1,).
    """
    barrier = np.concatenate([[0.0], np.cumsum(np.maximum(refusals, LEAST_REFUSAL))])
    wanted = np.linspace(0.0, barrier[-1], len(powers))
    moved = powers.copy()
    for k in range(1, len(powers) - 1):
        i = min(int(np.searchsorted(barrier, wanted[k], side="right")) - 1, len(powers) - 2)
        share = (wanted[k] - barrier[i]) / (barrier[i + 1] - barrier[i])
        upper, lower = powers[i], powers[i + 1]
        moved[k] = upper ** (1.0 - share) * lower**share if lower > 0.0 else upper * (1.0 - share)
    return moved


def penalised_log_likelihood(chain: Chain, cost: float) -> float:
    """Return E: the log likelihood less what occupied sensors cost, nats, which an inverse temperature multiplies."""
    occupied = int(chain.graph.counts[c.OCCUPIED])
    return float(chain.graph.sums[c.LOG_LIKELIHOOD]) - (cost * occupied if occupied else 0.0)


class Ladder(Plain):
    """The hot chains of one chain, their powers, and in which direction each map moves.

    `powers` (n,), `tried` (n - 1,), `rate_sum` (n - 1,), `came_from_hottest` (n,).
    """

    def __init__(self, target: Target, cold: Chain, rng: np.random.Generator, plan: LadderPlan) -> None:
        self.target = target
        self.spacing = SWAP_SPACING
        self.powers, self.finds_reach = plan.first_powers(), plan.lowest is None
        n = len(self.powers)
        self.tried = np.zeros(n - 1, np.int64)
        self.rate_sum = np.zeros(n - 1)
        self.came_from_hottest = np.arange(n) == n - 1
        self.round_trips = 0
        self.cost = plan.cost if plan.cost is not None else occupied_cost(target, len(cold.sensors.xy))
        self.first_step = int(cold.graph.counts[c.STEP])
        self.swap_rng, *self.generators = rng.spawn(n)
        self.hot = [without_image(cold) for _ in self.generators]
        self.apply_powers()

    def apply_powers(self) -> None:
        """Give every hot chain its power and the cost of occupied sensors."""
        for chain, power in zip(self.hot, self.powers[1:], strict=True):
            chain.density[c.LIKELIHOOD_POWER] = power
            chain.density[c.OCCUPIED_COST] = self.cost

    def begin(self, chain: Chain) -> None:
        """Before the first step: let every hot chain start from the map of the cold one."""
        coloring = read_coloring(chain.graph)
        self.hot = [with_map(hot, self.target, coloring) for hot in self.hot]

    def report(self) -> dict[str, Any]:
        """Return powers from 1 down, swaps, and the step at which tempering began.

        `swap_rates` are mean probabilities of a swap of each pair of neighbours since the powers were last moved, None
        where untried; `round_trips` are maps that returned to the cold chain from the hottest one, over the whole run.
        """
        tried = zip(self.rate_sum.tolist(), self.tried.tolist(), strict=True)
        return {
            "powers": self.powers.tolist(),
            "swap_rates": [total / n if n > 0 else None for total, n in tried],
            "round_trips": self.round_trips,
            "first_step": self.first_step,
        }

    def adapt(self, step: int) -> bool:
        """Move the powers if it is time to where all pairs are expected to refuse alike; return whether it was."""
        if step - self.first_step not in ADAPTATIONS or self.tried.sum() == 0:
            return False
        refusals = 1.0 - np.where(self.tried > 0, self.rate_sum / np.maximum(self.tried, 1), 0.5)
        self.powers = even_powers(self.powers, refusals)
        if self.finds_reach:
            self.powers = stretched_powers(self.powers, float(refusals.mean()))
        self.tried[:] = 0
        self.rate_sum[:] = 0.0
        self.apply_powers()
        return True

    def settle(self) -> None:
        """Recompute sums and lists of all hot chains."""
        for chain in self.hot:
            recompute_sums(chain)

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return the steps of all chains up to the next swap."""
        return self.run_all, min(stop, step - step % self.spacing + self.spacing)

    def run_all(self, cold: Chain, rng: np.random.Generator, step: int) -> Chain:
        """Run all chains up to `step`, and swap if it is time; return the cold one."""
        while not run(cold, rng, step):
            cold = grow(cold)
        for k, power in enumerate(self.powers[1:]):
            if power > 0.0:
                self.hot[k] = run_chain(self.hot[k], self.generators[k], step)
                redraw_directions(self.hot[k], self.target.orientation, self.generators[k])
            else:
                self.hot[k].graph.counts[c.STEP] = step
        return self.swap(cold, (step // self.spacing) % 2) if step % self.spacing == 0 else cold

    def swap(self, cold: Chain, parity: int) -> Chain:
        """Try to swap every second pair of neighbours, from the pair `parity` on; return the cold chain."""
        chains = [cold, *self.hot]
        for pair in range(parity, len(chains) - 1, 2):
            if self.powers[pair + 1] == 0.0:
                chains[pair + 1] = self.drawn_from_prior()
            log_ratio = self.log_swap_ratio(pair, chains[pair], chains[pair + 1])
            self.tried[pair] += 1
            self.rate_sum[pair] += math.exp(min(0.0, log_ratio))
            if math.log(1.0 - self.swap_rng.random()) < log_ratio:
                if pair == 0:
                    settle_image(cold)
                chains[pair], chains[pair + 1] = exchanged(chains[pair], chains[pair + 1])
                if pair == 0:
                    repaint(chains[0])
                self.follow(pair)
        cold, *self.hot = chains
        return cold

    def follow(self, pair: int) -> None:
        """Follow the maps of the chains `pair` and `pair` + 1 through their swap."""
        seen = self.came_from_hottest
        seen[pair], seen[pair + 1] = seen[pair + 1], seen[pair]
        seen[-1] = True
        if seen[0]:
            seen[0] = False
            self.round_trips += 1

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        """Return the log of the ratio with which the maps of two neighbours change places."""
        if pair == 0 and hotter.graph.counts[c.OCCUPIED] > 0:
            return -math.inf
        gain = penalised_log_likelihood(hotter, self.cost) - penalised_log_likelihood(colder, self.cost)
        return float((self.powers[pair] - self.powers[pair + 1]) * gain)

    def drawn_from_prior(self) -> Chain:
        """Return the hottest chain at a fresh draw of the prior."""
        target, rng = self.target, self.generators[-1]
        strength, angle = target.orientation.draw(rng)
        known = dataclasses.replace(target.orientation, strength=strength, angle=angle)
        draw = exact_draws(target.scale, target.window, 1, rng, known)[0]
        return with_map(self.hot[-1]._replace(lines=target.lines(strength, angle)), target, draw)
