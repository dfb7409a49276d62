"""Calibrations of min-marginals, and the choice among them by cross-validation over the folds that were kept out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression, minimize, minimize_scalar
from scipy.special import expit, logit

from mapq.crf.marginals import keep_sides
from mapq.model import ISOTONIC, LEAST_SLOPE, PLATT, TEMPERATURE, Calibration

SLOPES = (1e-3, 1e3)
"""Bounds of slopes: held-out patches whose differences are all 0 leave them free."""
GROUPS = 100
"""Groups of patches of like difference that an isotonic curve is fitted to, at most."""
SMALLEST_GROUP = 10
"""Patches of a group; with fewer than twice as many there is no curve."""

Floats = NDArray[np.float64]


class Chosen(NamedTuple):
    """A calibration and how it was chosen."""

    calibration: Calibration  # fitted to all patches
    losses: dict[str, float]  # kind to mean log-loss, in nats, on folds that the calibration had not seen
    probability: Floats  # (n,) of each patch, by a calibration of the chosen kind that had not seen its fold


def choose_calibration(difference: Floats, y: Floats, label: NDArray[np.uint8], fold: NDArray[np.int64]) -> Chosen:
    """Return the kind of calibration of least cross-validated log-loss, of equals the simplest, fitted to all patches.

    `difference` and `y` (n,): differences of min-marginals of patches that no model had seen, and their labels in {-1,
    +1}. `label` (n,): their best labels: probabilities are kept on that side of one half, here as in use. `fold` (n,):
    of the cross-validation. With one fold alone there is nothing to choose by: the kind is a temperature.
    """
    numbers = np.unique(fold)
    losses, found = {}, {}
    for kind, fit in FITS.items():
        p = np.full(len(y), np.nan)
        for number in numbers if len(numbers) > 1 else ():
            inside = fold == number
            if len(np.unique(y[~inside])) == 2:
                p[inside] = expit(fit(difference[~inside], y[~inside]).log_odds(difference[inside]))
        known = np.isfinite(p)
        if known.any():
            p[~known] = expit(fit(difference, y).log_odds(difference[~known]))
            found[kind] = keep_sides(p, label).astype(np.float64)
            sure = np.clip(found[kind][known], 1e-6, 1.0 - 1e-6)
            losses[kind] = float(-np.log(np.where(y[known] > 0.0, sure, 1.0 - sure)).mean())
    if not losses:
        calibration = fit_temperature(difference, y)
        return Chosen(calibration, {}, keep_sides(expit(calibration.log_odds(difference)), label).astype(np.float64))
    best = min(losses, key=lambda kind: losses[kind])
    return Chosen(FITS[best](difference, y), losses, found[best])


def fit_temperature(difference: Floats, y: Floats) -> Calibration:
    """Return the temperature of least log-loss, searched on its logarithm between `SLOPES`."""
    sure = _targets(y)
    low, high = np.log(SLOPES)

    def loss(logarithm: float) -> float:
        return _loss(np.exp(logarithm) * difference, sure)

    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-6})
    return Calibration(TEMPERATURE, float(np.exp(found.x)))


def fit_platt(difference: Floats, y: Floats) -> Calibration:
    """Return slope and intercept of least log-loss (Platt 1999, "Probabilistic outputs for support vector machines").

    The search begins at the temperature without an intercept.
    """
    sure, start = _targets(y), fit_temperature(difference, y).slope

    def loss(x: Floats) -> tuple[float, Floats]:
        wrong = expit(np.exp(x[0]) * difference + x[1]) - sure
        slope = float(np.mean(wrong * difference) * np.exp(x[0]))
        return _loss(np.exp(x[0]) * difference + x[1], sure), np.array([slope, float(np.mean(wrong))])

    bounds = [(float(np.log(SLOPES[0])), float(np.log(SLOPES[1]))), (-50.0, 50.0)]
    options = {"ftol": 1e-14, "gtol": 1e-10}
    found = minimize(loss, np.array([np.log(start), 0.0]), jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return Calibration(PLATT, float(np.exp(found.x[0])), float(found.x[1]))


def fit_isotonic(difference: Floats, y: Floats) -> Calibration:
    """Return the rising curve of least squares through groups of patches of like difference; few patches: Platt's.

    Shares of groups count as (suspicious + 1) / (n + 2), so that no patch is sure, and are joined by lines.
    """
    groups = _groups(difference, y)
    if len(groups) < 2:
        return fit_platt(difference, y)
    shares = np.array([float(np.mean(y[group] > 0.0)) for group in groups])
    counts = np.array([len(group) for group in groups], np.float64)
    blocks = isotonic_regression(shares, weights=counts).blocks
    at, value = [], []
    for first, last in pairwise(blocks.tolist()):
        members = np.concatenate(groups[first:last])
        at.append(float(difference[members].mean()))
        value.append(float(logit((np.count_nonzero(y[members] > 0.0) + 1.0) / (len(members) + 2.0))))
    knots = np.column_stack([at, np.maximum.accumulate(value)])
    knots[:, 1] += LEAST_SLOPE * (knots[:, 0] - knots[0, 0])
    return Calibration(ISOTONIC, knots=knots)


def _groups(difference: Floats, y: Floats) -> list[NDArray[np.int64]]:
    """Return which patches (n,) are of like difference, in groups of about one size, ascending.

    More patches of one difference than a group has stay together: what is coupled has one difference,
    and parted by its labels it would be sure of either.
    """
    n_groups = max(1, min(GROUPS, len(y) // SMALLEST_GROUP))
    order = np.lexsort((y, difference))
    ordered, edges = difference[order], np.cumsum([len(group) for group in np.array_split(order, n_groups)])[:-1]
    begin, end = (np.searchsorted(ordered, ordered[edges], side) for side in ("left", "right"))
    parted = (begin < edges) & (end - begin > len(order) / n_groups)
    kept = [0]
    for edge in np.where(parted, end, edges).tolist():
        if min(edge - kept[-1], len(order) - edge) >= SMALLEST_GROUP:
            kept.append(edge)
    return np.split(order, kept[1:])


FITS: Mapping[str, Callable[[Floats, Floats], Calibration]] = MappingProxyType(
    {TEMPERATURE: fit_temperature, PLATT: fit_platt, ISOTONIC: fit_isotonic}
)
"""How each kind is fitted, simplest first."""


def _targets(y: Floats) -> Floats:
    """Return the probabilities (n,) that labels mean: (n + 1) / (n + 2) for n patches of a label (Platt 1999).

    Patches that are all right would need an infinite slope otherwise.
    """
    n_suspicious, n_plausible = np.count_nonzero(y > 0.0), np.count_nonzero(y < 0.0)
    return np.where(y > 0.0, (n_suspicious + 1.0) / (n_suspicious + 2.0), 1.0 / (n_plausible + 2.0))


def _loss(log_odds: Floats, sure: Floats) -> float:
    return float(np.mean(sure * np.logaddexp(0.0, -log_odds) + (1.0 - sure) * np.logaddexp(0.0, log_odds)))
