"""Steps where they are needed: in regions round targets, which are drawn by how doubtful their returns are.

A region is drawn without a look at the map (:mod:`prf.sampler.doubts`), and the moves of the chain are confined to it
for a fixed number of steps (:mod:`prf.kernels.frozen`). Given what lies outside, they sample what lies inside: every
one of them leaves the posterior what it is, and so do all together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.kernels.frozen import confine, release
from prf.kernels.step import run
from prf.kernels.targets import NEAR
from prf.layout import grow, run_chain
from prf.posterior import BORDER_MOVES, Settings

TURN = 2000
"""Steps in one region, or between two on the whole window."""
TURNS = 2
"""So many turns make a cycle: one on the whole window, the others in a region each."""
MARGIN = 4
"""Squares of targets by which a region reaches beyond those near its middle."""
LEFT_OUT = (*BORDER_MOVES, c.CUT_WALL, c.MEND_WALL)
"""Moves that are not made in a region: those on the window's border, and those that ask for the length of all edges."""


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
    """Return how a chain steps in regions; None without a laser, whose returns say where, and under tiles."""
    has_targets = settings.laser is not None and len(chain.targets.cell) > 0
    return Focus(chain) if has_targets and not settings.tiles else None
