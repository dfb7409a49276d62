"""Whether chains agree: R-hat and effective sample size of functionals, the verdict, and what more time would bring.

Source of both: Vehtari, Gelman, Simpson, Carpenter, Buerkner (2021), Rank-normalization, folding and localization.
R-hat - 1 of chains that mix halves, or better, when a run doubles, and ESS doubles, so the ratio by which a run misses
its bounds is the ratio by which it is too short. Of chains that are caught in different modes R-hat stays: more time
alone does not help. :class:`prf.sampler.session.StopRule` ends a run by the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_RHAT = 1.05
MIN_ESS = 100.0
MAX_RHAT_UNSEEN = 1.2
"""Of what no reading saw: only the prior informs it, and no ESS is required."""
DRAWS_PER_CHAIN = 500
"""Draws a chain that R-hat and ESS look at: all functionals of four chains then cost a few milliseconds each."""
FEWEST_DRAWS = 8
"""A half chain of four draws is the least that a split R-hat is defined for."""
FEWEST_TO_COMPARE, MOST_RHAT = 25, 2.5
"""Draws a chain below which, and R-hat of the log likelihood above which, chains have hardly begun: that cells have the
colours of their starts in all of them is no agreement."""
STALLED = 0.75
"""Of R-hat - 1: more than this share of it left after twice the steps, and the chains do not come nearer."""
ROUND_NUMBERS = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 45)
"""Seconds in tens, minutes and hours that people give."""

WIDEST_OUTLOOK = 4.0
"""A time that may be more than so many times as long as it may be is not said."""

TIME_UNITS = ((86400.0, "day"), (3600.0, "hour"), (60.0, "minute"), (1.0, "second"))

Floats = NDArray[np.float64]
State = Literal["varies", "constant", "stuck", "short", "not finite"]
Trend = Literal["agree", "nearing", "flat", "unknown"]


class Diagnosis(NamedTuple):
    """Convergence of one functional."""

    # rank-normalised split R-hat, the larger of bulk and tail; nan where constant or too short, inf where stuck
    rhat: float
    ess: float  # bulk effective sample size over all chains, in draws; nan where constant or too short, 0 where stuck
    # "varies"; "constant" (one value in all chains); "stuck" (each half chain constant, at different values); "short"
    # (fewer than 8 draws a chain); "not finite" (nan or inf among the draws)
    state: State
    seen: bool = True  # whether it is of what readings saw; False for what they leave to the prior, all or in part

    @property
    def max_rhat(self) -> float:
        """R-hat at which the functional passes."""
        return MAX_RHAT if self.seen else MAX_RHAT_UNSEEN

    def agrees(self) -> bool:
        """Return whether the functional passes: constant, or R-hat and ESS (the latter if seen) within their bounds."""
        if self.state != "varies":
            return self.state == "constant"
        return self.rhat < self.max_rhat and (self.ess > MIN_ESS or not self.seen)

    def shortfall(self) -> float:
        """Return how far R-hat and ESS are from their bounds, the larger of two ratios: agreement is below 1."""
        if self.state != "varies":
            return 0.0 if self.state == "constant" else math.inf
        by_rhat = (self.rhat - 1.0) / (self.max_rhat - 1.0)
        return max(by_rhat, MIN_ESS / max(self.ess, 1e-9)) if self.seen else by_rhat

    def describe(self) -> str:
        """Return the diagnosis in words, such as ``R-hat 1.013, ESS 412`` or ``constant``."""
        words = {
            "constant": "constant",
            "stuck": "each chain constant, at different values",
            "short": f"fewer than {FEWEST_DRAWS} draws a chain",
            "not finite": "nan or inf among the draws",
        }
        return words.get(self.state, f"R-hat {self.rhat:.3f}, ESS {self.ess:.0f}")


class Verdict(NamedTuple):
    """Whether all functionals agree, and the one that is furthest from agreeing."""

    converged: bool
    worst: str  # that functional; one of what was seen comes before all others
    reason: str  # and its figures in words
    seen: bool  # whether all functionals of what was seen agree


def diagnose(
    functionals: Mapping[str, NDArray[Any]],
    unseen: Collection[str] = (),
    draws_per_chain: int = DRAWS_PER_CHAIN,
) -> dict[str, Diagnosis]:
    """Return R-hat and ESS of every functional; `functionals` (n_chains, n_draws)."""
    return {
        name: _diagnose_one(np.asarray(values, np.float64), draws_per_chain)._replace(seen=name not in unseen)
        for name, values in functionals.items()
    }


def _diagnose_one(values: Floats, draws_per_chain: int) -> Diagnosis:
    """Return the diagnosis of every k-th draw, counted from the newest."""
    n_draws = values.shape[1]
    stride = max(1, math.ceil(n_draws / draws_per_chain))
    chains = values[:, (n_draws - 1) % stride :: stride] if n_draws else values
    if chains.shape[1] < FEWEST_DRAWS or len(chains) == 0:
        return Diagnosis(math.nan, math.nan, "short")
    if not np.isfinite(chains).all():
        return Diagnosis(math.inf, 0.0, "not finite")
    if (chains == chains[0, 0]).all():
        return Diagnosis(math.nan, math.nan, "constant")
    halves = pieces(chains, 2)
    if (halves == halves[:, :1]).all():
        return Diagnosis(math.inf, 0.0, "stuck")
    compared = pieces(halves, 2) if len(chains) == 1 else halves
    folded = np.abs(compared - np.median(compared))
    rhat = np.fmax(_rhat(_normal_ranks(compared)), _rhat(_normal_ranks(folded)))
    ess = _effective_size(_normal_ranks(halves))
    return Diagnosis(math.inf if np.isnan(rhat) else float(rhat), 0.0 if np.isnan(ess) else float(ess), "varies")


def verdict(diagnoses: Mapping[str, Diagnosis]) -> Verdict:
    """Return whether every functional agrees; without any nothing is known: not converged."""
    if not diagnoses:
        return Verdict(False, "", "no functional was recorded", False)

    def badness(name: str) -> tuple[bool, bool, float]:
        found = diagnoses[name]
        return not found.agrees(), found.seen, found.shortfall()

    worst = max(diagnoses, key=badness)
    found = diagnoses[worst]
    where = "" if found.seen else ", on unseen ground"
    return Verdict(found.agrees(), worst, f"{worst}: {found.describe()}{where}", found.agrees() or not found.seen)


def outlook(
    half: Mapping[str, Diagnosis], now: Mapping[str, Diagnosis], seconds: float, climbs: bool
) -> tuple[Trend, tuple[float, float] | None]:
    """Return whether more time will bring agreement, from the diagnoses after half of the steps and now.

    "agree", or the chains come nearer ("nearing") or do not ("flat"), or that is unknown ("unknown"); and between how
    many more seconds it needs, if they come nearer. At best R-hat - 1 halves from now on each time the steps double, at
    worst it goes on falling as it did since half of the steps. None where both are too far apart to be of use.

    `climbs`: whether the log posterior of all chains still rises.
    """
    failing = {name: found for name, found in now.items() if not found.agrees()}
    if not failing:
        return "agree", None
    if any(found.state in ("short", "not finite") for found in (*half.values(), *now.values())):
        return "unknown", None
    by_rhat = [name for name, found in failing.items() if not found.rhat < found.max_rhat]
    before, after = (worst_rhat([each[name] for name in by_rhat]) for each in (half, now))
    if is_stalled(before, after):
        return "unknown" if climbs else "flat", None
    factor = max(found.shortfall() for found in failing.values())
    if not math.isfinite(factor):
        return "unknown", None
    fall = math.log2((before - 1.0) / (after - 1.0)) if after > 1.0 and math.isfinite(before) else 1.0
    low, high = ((factor ** (1.0 / power) - 1.0) * seconds for power in (1.0, min(fall, 1.0)))
    known = high <= WIDEST_OUTLOOK * low
    return "nearing", (rounded(low), rounded(high)) if known else None


def is_early(functionals: Mapping[str, Mapping[str, Any]], draws_per_chain: int) -> bool:
    """Return whether a run is too short to say where its chains agree; `functionals`: those of diagnostics.json."""
    found = functionals.get("log_likelihood") or {}
    rhat, state = found.get("rhat"), found.get("state", "constant")
    return draws_per_chain < FEWEST_TO_COMPARE or state in ("stuck", "not finite") or (rhat or 0.0) > MOST_RHAT


def is_stalled(before: float, now: float) -> bool:
    """Return whether R-hat stayed about what it was after half of the steps."""
    return math.isinf(now) or now - 1.0 > STALLED * (before - 1.0)


def disagree(half: Collection[Diagnosis], now: Collection[Diagnosis]) -> bool:
    """Return whether chains disagree on what was seen and do not come nearer.

    Where no reading saw the ground a power of the likelihood changes nothing.
    """
    before, found = (worst_rhat([each for each in diagnoses if each.seen]) for diagnoses in (half, now))
    return found > MAX_RHAT and is_stalled(before, found)


def worst_rhat(diagnoses: Collection[Diagnosis]) -> float:
    """Return the largest R-hat, inf if chains are constant at different values; 1 if there is none."""
    return max((found.rhat for found in diagnoses if not math.isnan(found.rhat)), default=1.0)


def rounded(seconds: float) -> float:
    """Return a time of few digits that is not shorter, or hardly."""
    times = (number * unit for unit in (10.0, 60.0, 3600.0) for number in ROUND_NUMBERS)
    return next((time for time in times if time >= 0.99 * seconds), 86400.0 * math.ceil(seconds / 86400.0))


def time_words(seconds: float) -> str:
    """Return a time in words."""
    unit, name = next(((unit, name) for unit, name in TIME_UNITS if seconds >= unit), TIME_UNITS[-1])
    return f"{round(seconds / unit)} {name}{'s' if seconds > unit else ''}"


def range_words(least: float, most: float) -> str:
    """Return in words a time between two, in seconds."""
    low, high = time_words(least), time_words(most)
    if low == high:
        return f"about {low}"
    number, unit = low.split()
    return f"{number} to {high}" if unit.rstrip("s") in high else f"{low} to {high}"


def effective_size(values: NDArray[Any]) -> Floats:
    """Return the effective sample size (n,) of the mean of each quantity; `values` (n_chains, n_draws, n)."""
    return _effective_size(pieces(np.asarray(values, np.float64), 2))


def split_rhat(values: NDArray[Any]) -> Floats:
    """Return split R-hat (n,) of each quantity of (n_chains, n_draws, n): 1 where all are equal, inf where stuck."""
    chains = np.asarray(values, np.float64)
    rhat = _rhat(pieces(chains, 2 if len(chains) > 1 else 4))
    return np.where(np.isnan(rhat), 1.0, rhat)


def pieces(chains: NDArray[Any], n_pieces: int) -> NDArray[Any]:
    """Return each chain cut into pieces of one length; the draws that are over are left out of the middle."""
    n_draws = chains.shape[1]
    length = n_draws // n_pieces
    starts = np.linspace(0, n_draws - length, n_pieces).astype(np.int64)
    return np.concatenate([chains[:, start : start + length] for start in starts])


def _normal_ranks(chains: Floats) -> Floats:
    """Return the normal scores of the ranks of all draws, in the shape of `chains`."""
    from scipy import special, stats  # noqa: PLC0415 - half a second

    ranks = stats.rankdata(chains, method="average").reshape(chains.shape)
    return np.asarray(special.ndtri((ranks - 0.375) / (chains.size + 0.25)))


def _rhat(chains: Floats) -> Floats:
    """Return R-hat of (n_chains, n_draws, ...), nan where all are equal."""
    n_draws = chains.shape[1]
    between = chains.mean(axis=1).var(axis=0, ddof=1)
    within = chains.var(axis=1, ddof=1).mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(between / within + (n_draws - 1) / n_draws))


def _effective_size(chains: Floats) -> Floats:
    """Return the effective sample size of (n_chains, n_draws, ...), nan where all are equal."""
    n_chains, n_draws = chains.shape[:2]
    covariance = _autocovariance(chains).mean(axis=0)
    total = covariance[0] + chains.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = 1.0 - (covariance[0] * n_draws / (n_draws - 1) - covariance) / total
    correlation[0] = 1.0
    time = np.maximum(_correlation_time(correlation), 1.0 / np.log10(n_chains * n_draws))
    return np.where(total > 0.0, n_chains * n_draws / time, np.nan)


def _autocovariance(chains: Floats) -> Floats:
    """Return the autocovariance of each chain and quantity at lags 0 to n_draws - 1, (n_chains, n_draws, ...)."""
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
    pairs = correlation[: 2 * last + 2].reshape(last + 1, 2, *correlation.shape[1:]).sum(axis=1)
    ends = pairs <= 0.0
    ends[0], ends[last] = False, True
    end = ends.argmax(axis=0)
    monotone = np.minimum.accumulate(pairs, axis=0)
    is_added = np.arange(last + 1).reshape(-1, *(1 for _ in end.shape)) < end
    added = np.where(is_added, monotone, 0.0).sum(axis=0)
    rest, pair = (np.take_along_axis(lags, k * end[None], axis=0)[0] for lags, k in ((correlation, 2), (pairs, 1)))
    time: Floats = -1.0 + 2.0 * added + np.where((rest > 0.0) | (pair >= 0.0), rest, 0.0)
    return time
