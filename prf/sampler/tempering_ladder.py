"""The ladder of parallel tempering: powers of the likelihood from 1 down, and what swaps between rungs tell of it.

Swaps alternate between even and odd pairs of neighbours, which carries maps through the ladder faster than random
pairs do, and the powers are moved until all pairs refuse alike. Source of both: Syed, Bouchard-Cote, Deligiannidis,
Doucet (2022), Non-reversible parallel tempering.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]

FIRST_RATIO = 0.9
"""Ratio of neighbouring powers before anything is measured, where the ladder finds its own reach."""
FIRST_DECADES = 3.0
"""Decades that the positive powers of a full ladder span before anything is measured."""
WANTED_REFUSAL = 0.5
"""Share of swaps to be refused, where the ladder finds its own reach: about the best for so many rungs."""
MOST_STRETCH = 2.0
"""The logarithm of the lowest power changes by no more than this factor at a time."""
LOWEST_REACH = 1e-3
HIGHEST_REACH = 0.98
"""Bounds of the lowest power of a ladder that finds its own reach."""
AUTO_RUNGS = 6
"""Rungs of chains that were seen to stay apart, where nobody said how many."""
LEAST_REFUSAL = 0.01
"""Share of swaps that a pair is taken to refuse at least: pairs that never refuse still keep a distance."""


@dataclasses.dataclass(frozen=True)
class LadderPlan:
    """What is asked of a ladder."""

    rungs: int  # chains of maps, the cold one among them; 1: no ladder
    # the lowest power of the likelihood. 0: the prior, from which that rung has exact draws. None: as low as half of
    # all swaps are accepted, found in burn-in
    hottest: float | None = None
    # nats of log likelihood that an occupied sensor costs below power 1; None chooses it from the readings
    cost: float | None = None
    waits: bool = False  # whether the rungs come only when chains stay apart (:mod:`prf.sampler.apart`)

    def __post_init__(self) -> None:
        """Refuse what is no ladder."""
        if self.rungs < 1:
            raise ConfigError(f"sampler.rungs {self.rungs}: must be at least 1")
        if self.hottest is not None and not 0.0 <= self.hottest < 1.0:
            raise ConfigError(f"sampler.hottest {self.hottest}: must be at least 0 and below 1")
        if self.cost is not None and not (math.isfinite(self.cost) and self.cost >= 0.0):
            raise ConfigError(f"cost of an occupied sensor {self.cost}: must be a finite number of nats, not negative")

    def first_powers(self) -> Floats:
        """Return the powers (rungs,) before anything is measured: evenly spaced logarithms, and 0 if asked for."""
        if self.hottest is None:
            return FIRST_RATIO ** np.arange(self.rungs, dtype=np.float64)
        if self.hottest > 0.0:
            return np.geomspace(1.0, self.hottest, self.rungs)
        lowest = 10.0 ** (-FIRST_DECADES * (self.rungs - 2) / max(self.rungs - 1, 1))
        positive = np.geomspace(1.0, lowest, self.rungs - 1) if self.rungs > 2 else np.ones(self.rungs - 1)
        return np.append(positive, 0.0)


class SwapReport(NamedTuple):
    """What a ladder has come to."""

    powers: list[float]  # of the rungs, from 1 down
    # mean probability of a swap of each pair of neighbours since the powers were last moved; None where untried
    swap_rates: list[float | None]
    round_trips: int  # maps that came back to the cold rung from the hottest one, over the whole run
    first_step: int  # step at which the rungs were put below their chain


class Ladder:
    """Powers, swap rates, and which way each map was carried.

    `powers` (rungs,), `tried` (rungs - 1,), `rate_sum` (rungs - 1,), `came_from_hottest` (rungs,).
    """

    def __init__(self, powers: Floats, finds_reach: bool = False) -> None:
        self.powers = powers.copy()
        self.finds_reach = finds_reach
        n = len(powers)
        self.tried = np.zeros(n - 1, np.int64)
        self.rate_sum = np.zeros(n - 1)
        self.came_from_hottest = np.zeros(n, np.bool_)
        self.came_from_hottest[-1] = True
        self.round_trips = 0

    @property
    def rungs(self) -> int:
        """Number of rungs."""
        return len(self.powers)

    def note(self, pair: int, probability: float) -> None:
        """Count a swap that was tried between the rungs `pair` and `pair` + 1."""
        self.tried[pair] += 1
        self.rate_sum[pair] += probability

    def carry(self, pair: int) -> None:
        """Let the maps of the rungs `pair` and `pair` + 1 change places."""
        seen = self.came_from_hottest
        seen[pair], seen[pair + 1] = seen[pair + 1], seen[pair]
        seen[-1] = True
        if seen[0]:
            seen[0] = False
            self.round_trips += 1

    def refusals(self) -> Floats:
        """Return the share of swaps refused, (rungs - 1,); a half where none was tried."""
        return 1.0 - np.where(self.tried > 0, self.rate_sum / np.maximum(self.tried, 1), 0.5)

    def even_out(self) -> None:
        """Move the powers to where all pairs are expected to refuse alike, and count anew."""
        refusals = self.refusals()
        self.powers = even_powers(self.powers, refusals)
        if self.finds_reach:
            self.powers = stretched_powers(self.powers, float(refusals.mean()))
        self.tried[:] = 0
        self.rate_sum[:] = 0.0

    def report(self, first_step: int) -> SwapReport:
        """Return powers, swap rates and round trips of rungs that are there since `first_step`."""
        rates = [
            float(total / n) if n > 0 else None for total, n in zip(self.rate_sum, self.tried.tolist(), strict=True)
        ]
        return SwapReport(self.powers.tolist(), rates, self.round_trips, first_step)


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
