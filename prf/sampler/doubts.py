"""How probable each target is: returns that maps explain at some times, and at others not, are aimed at most.

How often each return was left unexplained is counted, look by look. The targets follow when the number of blocks is a
power of two, in all chains alike, and stand until then: in between no proposal depends on the map in any way that its
density does not know. Adaptation that becomes rarer and rarer leaves the limit of all averages what it is
(Chimisov, Latuszynski, Roberts 2018, Air Markov chain Monte Carlo).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.build import cells_of
from prf.kernels.chain import Chain

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
        """Let what was counted so far count less than what is to come."""
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
    """Return whether targets are set anew: whether the number of blocks has come to a power of two, or passed one."""
    return before.bit_length() != blocks.bit_length()


def target_of_beams(chain: Chain) -> NDArray[np.int32]:
    """Return the target (n_beams,) in which the return of each beam lies, NONE where there is none."""
    targets, ray = chain.targets, chain.beams.ray
    ends = ray[:, :2] + np.where(has_return(chain), ray[:, c.RANGE], 0.0)[:, None] * ray[:, 2:4]
    cells = np.zeros(len(ray), np.int64)
    cells_of(targets.grid, np.ascontiguousarray(ends), cells)
    return np.where(has_return(chain), targets.number[cells], c.NONE)


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
