"""Where steps are aimed: at returns that maps explain at some times and not at others.

How often each return was left unexplained is counted. The probabilities of the targets follow when the
number of blocks is a power of two, in all chains alike: in between no proposal depends on the map in a way that its
density does not know. Adaptation that becomes rarer and rarer keeps the limit of all averages (Chimisov,
Latuszynski, Roberts 2018, Air Markov chain Monte Carlo).

Every second turn of a chain is spent in a region round a target, drawn without a look at the map. The moves are
confined to it for a number of steps (:mod:`prf.kernels.state.frozen`): given what lies outside they sample what lies
inside, so that each leaves the posterior what it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.frozen import confine, release
from prf.kernels.state.grid import cells_of
from prf.kernels.state.targets import NEAR
from prf.kernels.step import run
from prf.model.layout import grow, run_chain
from prf.sampler.posterior import BORDER_MOVES, Settings

UNEXPLAINED = 4.0
"""Nats that an unexplained return lacks at least to the best that any map could do for it."""
EVEN = 0.3
"""Share of the probability that all targets have alike."""
NEVER = 0.1
"""Weight of a return that no map ever explained; one that half of the maps explained has 1/4."""
MEMORY = 0.5
"""Weight of what was counted before, each time that targets are set."""


class Doubts:
    """How often the returns of one chain were left unexplained; `count` (n_beams,)."""

    def __init__(self, chain: Chain) -> None:
        self.count = np.zeros(len(chain.beams.ray))
        self.looks = 0.0

    def look(self, chain: Chain) -> None:
        """Count the returns that no edge explains now."""
        self.count += unexplained(chain)
        self.looks += 1.0

    def fade(self) -> None:
        """Let what was counted so far count less than later looks."""
        self.count *= MEMORY
        self.looks *= MEMORY


def aim(chains: Sequence[Chain], doubts: Sequence[Doubts]) -> None:
    """Set the probabilities of the targets of all chains by what was counted in all of them."""
    looks = sum(each.looks for each in doubts)
    targets, beams = chains[0].targets, chains[0].beams
    n = len(targets.cell)
    if n == 0 or looks == 0.0 or len(beams.ray) == 0:
        return
    share = np.asarray(sum(each.count for each in doubts)) / looks
    weight = share * (1.0 - share) + NEVER * share
    of_target = target_of_beams(chains[0])
    aimed = of_target != c.NONE
    total = np.bincount(of_target[aimed], weight[aimed], n)
    if total.sum() > 0.0:
        cumulative = np.cumsum(EVEN / n + (1.0 - EVEN) * total / total.sum())
        for chain in chains:
            chain.targets.cumulative[:] = cumulative / cumulative[-1]
    for each in doubts:
        each.fade()


def is_due(before: int, blocks: int) -> bool:
    """Return whether targets are set again: whether the number of blocks has reached a power of two, or passed one."""
    return before.bit_length() != blocks.bit_length()


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


TURN = 2000
"""Steps in one region, or between two on the whole window."""
TURNS = 2
"""Turns in a cycle: one on the whole window, the others in a region each."""
MARGIN = 4
"""Squares of targets by which a region reaches beyond those near its middle."""
LEFT_OUT = (*BORDER_MOVES, c.CUT_WALL, c.MEND_WALL)
"""Moves that are not made in a region: those on the window's border, and those that need the length of all edges."""


class Focus:
    """How one chain steps in regions."""

    def __init__(self, chain: Chain) -> None:
        self.half = (NEAR + MARGIN) * chain.targets.grid.cell
        self._move_probabilities = chain.move_probabilities.copy()
        self._move_probabilities[list(LEFT_OUT)] = 0.0
        self._move_probabilities /= self._move_probabilities.sum()

    def run_to(self, chain: Chain, rng: np.random.Generator, step: int) -> Chain:
        """Run a chain up to `step`, turn by turn; return it."""
        while chain.graph.counts[c.STEP] < step:
            turn = int(chain.graph.counts[c.STEP]) // TURN
            end = min(step, (turn + 1) * TURN)
            if turn % TURNS == 0:
                chain = run_chain(chain, rng, end)
            else:
                target = int(np.searchsorted(chain.targets.cumulative, rng.random(), side="right"))
                chain = self.run_in_region(chain, rng, target, end)
        return chain

    def run_in_region(self, chain: Chain, rng: np.random.Generator, target: int, step: int) -> Chain:
        """Run a chain up to `step` in the region round a target; return it."""
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


def focus_of(settings: Settings, chain: Chain) -> Focus | None:
    """Return how a chain steps in regions; None without a laser, whose returns are the targets, and under tiles."""
    has_targets = settings.laser is not None and len(chain.targets.cell) > 0
    return Focus(chain) if has_targets and not settings.tiles else None
