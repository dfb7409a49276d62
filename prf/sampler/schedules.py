"""Schedules of a chain: which steps come next. Here the plain one, and regions round returns that maps leave in doubt.

How often each return was left unexplained is counted. The probabilities of the targets follow when the
number of blocks is a power of two, in all chains alike: in between no proposal depends on the map in a way that its
density does not know. Adaptation that becomes rarer and rarer keeps the limit of all averages (Chimisov,
Latuszynski, Roberts 2018, Air Markov chain Monte Carlo).

Every second turn of a chain is spent in a region round a target, drawn without a look at the map. The moves are
confined to it for a number of steps (:mod:`prf.kernels.state.frozen`): given what lies outside they sample what lies
inside, so that each leaves the posterior what it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.frozen import confine, release
from prf.kernels.state.grid import cells_of
from prf.kernels.state.targets import NEAR
from prf.kernels.step import run
from prf.model.layout import grow
from prf.sampler.state import BORDER_MOVES, run_chain
from prf.sampler.target import Target

if TYPE_CHECKING:
    from prf.sampler.chain import ChainRun

UNEXPLAINED = 4.0
"""Nats that an unexplained return lacks at least to the best that any map could do for it."""
EVEN = 0.3
"""Share of the probability that all targets have alike."""
NEVER = 0.1
"""Weight of a return that no map ever explained; one that half of the maps explained has 1/4."""
MEMORY = 0.5
"""Weight of what was counted before, each time that targets are set."""
TURN = 2000
"""Steps in one region, or between two on the whole window."""
TURNS = 2
"""Turns in a cycle: one on the whole window, the others in a region each."""
MARGIN = 4
"""Squares of targets by which a region reaches beyond those near its middle."""
LEFT_OUT = (*BORDER_MOVES, c.CUT_WALL, c.MEND_WALL)
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
    """Turns on the whole window and in regions round targets."""

    def __init__(self, chain: Chain) -> None:
        self.half = (NEAR + MARGIN) * chain.targets.grid.cell
        self._move_probabilities = chain.move_probabilities.copy()
        self._move_probabilities[list(LEFT_OUT)] = 0.0
        self._move_probabilities /= self._move_probabilities.sum()

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return the turn on the window, or in a region, that `step` belongs to."""
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
    return target.laser is not None and len(chain.targets.cell) > 0 and not target.execution.tiles


def is_aimed(before: int, blocks: int) -> bool:
    """Return whether targets are set again: whether the number of blocks has reached a power of two, or passed one."""
    return before.bit_length() != blocks.bit_length()


def aim(chains: Sequence[ChainRun]) -> None:
    """Set the probabilities of the targets of all chains by what was left unexplained in all of them."""
    looks = sum(each.n_looks for each in chains)
    first = chains[0].chain
    n = len(first.targets.cell)
    if n == 0 or looks == 0.0 or len(first.beams.ray) == 0:
        return
    share = np.asarray(sum(each.n_unexplained for each in chains)) / looks
    weight = share * (1.0 - share) + NEVER * share
    of_target = target_of_beams(first)
    aimed = of_target != c.NONE
    total = np.bincount(of_target[aimed], weight[aimed], n)
    if total.sum() > 0.0:
        cumulative = np.cumsum(EVEN / n + (1.0 - EVEN) * total / total.sum())
        for each in chains:
            each.chain.targets.cumulative[:] = cumulative / cumulative[-1]
    for each in chains:
        each.n_unexplained *= MEMORY
        each.n_looks *= MEMORY


def target_of_beams(chain: Chain) -> NDArray[np.int32]:
    """Return the target (n_beams,) in which the return of each beam lies, NONE where there is none."""
    targets, ray = chain.targets, chain.beams.ray
    ends = ray[:, :2] + np.where(has_return(chain), ray[:, c.RANGE], 0.0)[:, None] * ray[:, 2:4]
    return np.where(has_return(chain), targets.number[cells_of(targets.grid, ends)], c.NONE)


def has_return(chain: Chain) -> NDArray[np.bool_]:
    """Return which beams have a return inside the window."""
    reading = chain.beams.ray[:, c.RANGE]
    found: NDArray[np.bool_] = np.isfinite(reading) & (reading >= 0.0)
    return found


def unexplained(chain: Chain) -> NDArray[np.bool_]:
    """Return which beams have a return that no edge explains."""
    lacks = chain.beams.best - chain.beams.ray[:, c.BEAM_LOG_LIKELIHOOD]
    found: NDArray[np.bool_] = has_return(chain) & (lacks > UNEXPLAINED)
    return found
