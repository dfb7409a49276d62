"""How far the Monte Carlo error may carry a share of draws: intervals, effective sample size, R-hat.

Derivation and measured coverage: docs/convergence.md. ESS and R-hat are those of Vehtari, Gelman, Simpson, Carpenter,
Buerkner (2021), for thousands of quantities at once: of a binary quantity the rank-normalised forms are the plain ones.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prf.diagnostics import FEWEST_DRAWS

LEVEL = 0.95
PIECES = 8
"""Chains are cut into halves, fewer chains into so many pieces in all, whose means are compared."""
DRAWS_PER_DEGREE = 20.0
"""A long run has a degree of freedom for so many effective draws, if that is more than the pieces give."""
FEWEST_OF_A_COLOUR = 3.0
"""Effective draws of a colour below which that colour may as well have no probability at all."""
MOST_VALUES = 1_000_000
"""Values, draws times quantities, whose autocorrelation is computed at once (80 bytes each)."""

Floats = NDArray[np.float64]


class Estimates(NamedTuple):
    """Probabilities, and how far they are known: their Monte Carlo error alone. One a quantity.

    Attributes
    ----------
    probability : (n,) float64
        Share of draws.
    low, high : (n,) float64
        The probability that endless chains would give lies between them at 95 %.
    ess : (n,) float64
        Effective sample size in draws; of draws that are all equal, the smallest of the run. nan: not known.
    rhat : (n,) float64
        Split R-hat; 1 where all draws are equal, inf where each half chain is constant at its own value. nan: not
        known.
    """

    probability: Floats
    low: Floats
    high: Floats
    ess: Floats
    rhat: Floats


def by_chain(values: NDArray[Any], chain: NDArray[np.int32]) -> NDArray[Any]:
    """Return the rows of `values` (n, ...) as (n_chains, n_draws, ...), each chain's in their order.

    The oldest draws are left out of a chain that has more than another.
    """
    kept = [np.flatnonzero(chain == one) for one in np.unique(chain)]
    n_draws = min((len(rows) for rows in kept), default=0)
    rows = np.array([rows[len(rows) - n_draws :] for rows in kept], np.int64).reshape(len(kept), n_draws)
    return values[rows]


def estimates(black: NDArray[np.bool_], smallest_ess: float) -> Estimates:
    """Return the probability of each quantity with bounds at 95 %; `black` (n_chains, n_draws, n)."""
    n_chains, n_draws, n = black.shape
    if n_draws < FEWEST_DRAWS:
        unknown = np.full(n, np.nan)
        return Estimates(black.mean(axis=(0, 1)), np.zeros(n), np.ones(n), unknown, unknown)
    batch = max(1, MOST_VALUES // (n_chains * n_draws))
    starts = range(0, max(n, 1), batch)
    parts = [_batch(black[:, :, start : start + batch], smallest_ess) for start in starts]
    return Estimates(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def effective_size(values: NDArray[Any]) -> Floats:
    """Return the effective sample size of the mean of each quantity, over split chains.

    `values` (n_chains, n_draws, n).
    """
    halves = _pieces(np.asarray(values, np.float64), 2)
    n_halves, n_draws, _ = halves.shape
    covariance = _autocovariance(halves).mean(axis=0)
    total = covariance[0] + halves.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = 1.0 - (covariance[0] * n_draws / (n_draws - 1) - covariance) / total
    correlation[0] = 1.0
    time = np.maximum(_correlation_time(correlation), 1.0 / np.log10(n_halves * n_draws))
    size: Floats = np.where(total > 0.0, n_halves * n_draws / time, np.nan)
    return size


def split_rhat(values: NDArray[Any]) -> Floats:
    """Return split R-hat of each quantity of (n_chains, n_draws, n) values: 1 where all are equal, inf where stuck."""
    chains = np.asarray(values, np.float64)
    halves = _pieces(chains, 2 if len(chains) > 1 else 4)
    n_draws = halves.shape[1]
    between = halves.mean(axis=1).var(axis=0, ddof=1)
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        rhat = np.sqrt(between / within + (n_draws - 1) / n_draws)
    return np.where(between + within > 0.0, rhat, 1.0)


def smallest_ess(colours: NDArray[np.bool_], functionals: Floats) -> float:
    """Return the effective sample size that draws which are all equal count for: the smallest of a run.

    `colours` (n_chains, n_draws, n_probes), `functionals` (n_chains, n_draws, n_functionals).
    """
    n_chains, n_draws, _ = functionals.shape
    if n_draws < FEWEST_DRAWS:
        return float(n_chains)
    for values in (colours, functionals):
        sizes = effective_size(values)
        if not np.isnan(sizes).all():
            return max(float(np.nanmin(sizes)), float(n_chains))
    return float(n_chains)


def _batch(black: NDArray[np.bool_], smallest_ess: float) -> Estimates:
    n_chains, n_draws, _ = black.shape
    share = black.mean(axis=(0, 1))
    spread = share * (1.0 - share)
    ess = effective_size(black)
    pieces = _pieces(black, max(2, -(-PIECES // n_chains)))
    variance = np.fmax(spread / ess, _variance_of_mean(pieces))
    if n_chains > 1:
        variance = np.maximum(variance, _variance_of_mean(black))
    with np.errstate(invalid="ignore"):
        size = np.clip(np.where(spread > 0.0, spread / variance, 1.0), 1.0, n_chains * n_draws)
    low, high = _wilson(share, size, np.maximum(len(pieces) - 1.0, size / DRAWS_PER_DEGREE))
    low = np.where(share * size < FEWEST_OF_A_COLOUR, 0.0, low)
    high = np.where((1.0 - share) * size < FEWEST_OF_A_COLOUR, 1.0, high)
    bound = -np.expm1(np.log(1.0 - LEVEL) / smallest_ess)  # rule of three: (1 - bound) ** ess = 0.05
    low = np.where(share == 1.0, 1.0 - bound, low)
    high = np.where(share == 0.0, bound, high)
    return Estimates(share, low, high, np.where(spread > 0.0, ess, smallest_ess), split_rhat(black))


def _wilson(share: Floats, size: Floats, degrees: Floats) -> tuple[Floats, Floats]:
    """Return the probabilities whose `size` independent draws differ from `share` by the quantile of Student's t."""
    quantile = special.stdtrit(degrees, 0.5 * (1.0 + LEVEL))
    shrink = quantile**2 / size
    centre = (share + 0.5 * shrink) / (1.0 + shrink)
    half = np.sqrt(shrink * (share * (1.0 - share) + 0.25 * shrink)) / (1.0 + shrink)
    return np.maximum(centre - half, 0.0), np.minimum(centre + half, 1.0)


def _variance_of_mean(pieces: NDArray[Any]) -> Floats:
    """Return the variance of the mean over all pieces (k, n_draws, n), taken as independent."""
    variance: Floats = pieces.mean(axis=1).var(axis=0, ddof=1) / len(pieces)
    return variance


def _pieces(chains: NDArray[Any], n_pieces: int) -> NDArray[Any]:
    """Return each chain cut into pieces of one length; the draws that are over are left out of the middle."""
    n_draws = chains.shape[1]
    length = n_draws // n_pieces
    starts = np.linspace(0, n_draws - length, n_pieces).astype(np.int64)
    return np.concatenate([chains[:, start : start + length] for start in starts])


def _autocovariance(chains: Floats) -> Floats:
    """Return the autocovariance of each chain and quantity at lags 0 to n_draws - 1, (n_chains, n_draws, n)."""
    n_draws = chains.shape[1]
    padded = 1 << (2 * n_draws - 1).bit_length()
    spectrum = np.fft.rfft(chains - chains.mean(axis=1, keepdims=True), padded, axis=1)
    power = spectrum.real**2 + spectrum.imag**2
    covariance: Floats = np.fft.irfft(power, padded, axis=1)[:, :n_draws] / n_draws
    return covariance


def _correlation_time(correlation: Floats) -> Floats:
    """Return the integrated autocorrelation time, in draws, by Geyer's initial monotone sequence.

    Sums of neighbouring lags are added while they are positive, each at most as large as the one before.
    """
    last = max((len(correlation) - 3) // 2, 0)
    pairs = correlation[: 2 * last + 2].reshape(last + 1, 2, -1).sum(axis=1)
    ends = pairs <= 0.0
    ends[0], ends[last] = False, True
    end = ends.argmax(axis=0)
    monotone = np.minimum.accumulate(pairs, axis=0)
    added = np.where(np.arange(last + 1)[:, None] < end, monotone, 0.0).sum(axis=0)
    time: Floats = -1.0 + 2.0 * added + np.maximum(np.take_along_axis(correlation, 2 * end[None], axis=0)[0], 0.0)
    return time
