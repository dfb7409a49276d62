"""Ranks of the truth among draws, and the band in which their distribution stays if they are uniform.

If truth and draws come from one posterior, the number of draws below the truth is uniform on 0 ... L whatever is
compared (Talts et al. 2018, Validating Bayesian inference algorithms with simulation-based calibration). The band is
simultaneous over all places at which the distribution of the ranks is looked at, and exact up to the simulation of one
quantile (Säilynoja, Bürkner, Vehtari 2021, Graphical test for discrete uniformity, section 2).
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

N_SETS = 20_000
"""Simulated sets of uniform ranks: the standard error of a 1 % tail is 0.07 %."""
SEED = 1


class Verdict(NamedTuple):
    """How uniform ranks are.

    Attributes
    ----------
    p : float
        Share of sets of uniform ranks that stray as far somewhere.
    outside : int
        Places at which the distribution leaves the band.
    """

    p: float
    outside: int


class Band(NamedTuple):
    """Simultaneous band of the counts of ranks below k = 1 ... L.

    Attributes
    ----------
    n : int
        Ranks.
    n_draws : int
        L: ranks are 0 ... L.
    low, high : (L,) int arrays
        Least and greatest number of ranks below k that lies in the band.
    strays : (N_SETS,) array
        Sorted: how unlikely the most unlikely count of each simulated set is.
    pointwise : (L, n + 1) array
        Twice the smaller tail of every count at every place.
    """

    n: int
    n_draws: int
    low: Ints
    high: Ints
    strays: Floats
    pointwise: Floats

    def judge(self, ranks: ArrayLike) -> Verdict:
        """Return how far ranks (n,) stray."""
        counts = counts_below(np.asarray(ranks)[None, :], self.n_draws)[0]
        found = self.pointwise[np.arange(self.n_draws), counts].min()
        outside = int(((counts < self.low) | (counts > self.high)).sum())
        return Verdict(float(np.searchsorted(self.strays, found, side="right") / len(self.strays)), outside)


def rank_of(truth: ArrayLike, draws: ArrayLike, rng: np.random.Generator) -> Ints:
    """Return the rank of each true value among its draws, ties broken at random.

    Parameters
    ----------
    truth : (k,) array
    draws : (n_draws, k) array
    rng : numpy.random.Generator

    Returns
    -------
    (k,) int array
        0 ... n_draws.
    """
    below = (np.asarray(draws) < truth).sum(axis=0)
    tied = (np.asarray(draws) == truth).sum(axis=0)
    ranks: Ints = below + rng.integers(0, tied + 1)
    return ranks


def counts_below(ranks: NDArray[np.generic], n_draws: int) -> Ints:
    """Return how many of each set's ranks (sets, n) lie below k = 1 ... n_draws, (sets, n_draws)."""
    sets = len(ranks)
    place = ranks.astype(np.int64) + (n_draws + 1) * np.arange(sets)[:, None]
    counts = np.bincount(place.ravel(), minlength=sets * (n_draws + 1)).reshape(sets, n_draws + 1)
    below: Ints = np.cumsum(counts, axis=1)[:, :-1]
    return below


@cache
def make_band(n: int, n_draws: int, confidence: float = 0.99) -> Band:
    """Return the band that `n` uniform ranks on 0 ... `n_draws` leave with probability 1 - `confidence`."""
    share = np.arange(1, n_draws + 1) / (n_draws + 1)
    count = np.arange(n + 1)
    at_most = stats.binom.cdf(count, n, share[:, None])
    at_least = stats.binom.sf(count - 1, n, share[:, None])
    pointwise = np.minimum(1.0, 2.0 * np.minimum(at_most, at_least))
    rng = np.random.default_rng([SEED, n, n_draws])
    sets = np.cumsum(rng.multinomial(n, np.full(n_draws + 1, 1.0 / (n_draws + 1)), N_SETS), axis=1)[:, :-1]
    strays = np.sort(pointwise[np.arange(n_draws), sets].min(axis=1))
    # The largest value that at most the wanted share of the sets reaches or falls below.
    limit = strays[round((1.0 - confidence) * N_SETS)]
    inside = pointwise >= limit
    low, high = inside.argmax(axis=1), n - inside[:, ::-1].argmax(axis=1)
    return Band(n, n_draws, low, high, strays, pointwise)
