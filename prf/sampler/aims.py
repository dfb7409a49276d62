"""Which returns chains are aimed at: those that were left in doubt, and in a run that goes on the new ones.

How often each return was left unexplained is counted. The probabilities of the targets follow when the
number of blocks is a power of two, in all chains alike: in between no proposal depends on the map in a way that its
density does not know. Adaptation that becomes rarer and rarer keeps the limit of all averages (Chimisov,
Latuszynski, Roberts 2018, Air Markov chain Monte Carlo).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.grid import cells_of
from prf.sampler.target import Target

if TYPE_CHECKING:
    from prf.sampler.chain import ChainRun

UNEXPLAINED = 4.0
"""Nats that an unexplained return lacks at least to the best that any map could do for it."""
EVEN = 0.3
"""Share of the probability that all targets have alike."""
NEW = 0.5
"""Share of it that is for the targets of new readings, in a run that goes on from another one."""
NEVER = 0.1
"""Weight of a return that no map ever explained; one that half of the maps explained has 1/4."""
MEMORY = 0.5
"""Weight of what was counted before, each time that targets are set."""


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
        set_shares(chains, EVEN * even_shares(chains[0].target, first) + (1.0 - EVEN) * total / total.sum())
    for each in chains:
        each.n_unexplained *= MEMORY
        each.n_looks *= MEMORY


def set_shares(chains: Sequence[ChainRun], share: NDArray[np.float64]) -> None:
    """Set the probabilities (n_targets,) of the targets of all chains."""
    cumulative = np.cumsum(share)
    for each in chains:
        each.chain.targets.cumulative[:] = cumulative / cumulative[-1]


def even_shares(target: Target, chain: Chain) -> NDArray[np.float64]:
    """Return the share (n_targets,) of each target before any is known to be in doubt.

    They are alike; but in a run that goes on from another one :data:`NEW` of them all is for those of new readings.
    """
    n, first = len(chain.targets.cell), target.tuning.first_new_log
    even = np.full(n, 1.0 / max(n, 1))
    if first == 0 or target.laser is None:
        return even
    of_target = target_of_beams(chain)
    new = np.bincount(of_target[(of_target != c.NONE) & (target.laser.readings.log >= first)], minlength=n)
    return even if new.sum() == 0 else (1.0 - NEW) * even + NEW * new / new.sum()


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
    found: NDArray[np.bool_] = has_return(chain) & (lacks > UNEXPLAINED * np.maximum(chain.beams.weight, 1.0))
    return found
