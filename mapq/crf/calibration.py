"""Probabilities of labels from differences of min-marginals, and operating points, by folds that were kept out.

Min-marginals always agree with the best labelling, and trained ones are well calibrated (Tarlow and Adams 2012,
"Revisiting uncertainty in graph cut solutions"); marginals by belief propagation were wrong at strong coupling.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression, minimize, minimize_scalar
from scipy.special import expit, logit

from mapq.labels import SUSPICIOUS
from mapq.model import ISOTONIC, LEAST_SLOPE, PLATT, TEMPERATURE, Calibration, Model
from prf.shell.errors import UsageError

SLOPES = (1e-3, 1e3)
"""Bounds of slopes: held-out patches whose differences are all 0 leave them free."""
GROUPS = 100
"""Groups of patches of like difference that an isotonic curve is fitted to, at most."""
SMALLEST_GROUP = 10
"""Patches of a group; with fewer than twice as many there is no curve."""

SHARES = (
    *(0.0, 0.001, 0.002, 0.003, 0.005, 0.007),
    *(0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.08),
    *(0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5),
)
"""False alarms of the operating points that a model keeps."""

Floats = NDArray[np.float64]


def probabilities(difference: Floats, label: NDArray[np.uint8], model: Model) -> NDArray[np.float32]:
    """Return the probability (m,) that a patch is suspicious, from the difference (m,) of its min-marginals.

    In float32, and never exactly that of the model's threshold (:func:`cut_probability`): above it where the label (m,)
    is suspicious, ties included, and below elsewhere.
    """
    return keep_sides(expit(model.calibration.log_odds(difference)), label, cut_probability(model))


def cut_probability(model: Model) -> float:
    """Return the probability above which patches are called suspicious: one half for the best labelling."""
    if model.threshold == 0.0:
        return 0.5
    return float(expit(model.calibration.log_odds(np.array([model.threshold])))[0])


def keep_sides(p: Floats, label: NDArray[np.uint8], cut: float = 0.5) -> NDArray[np.float32]:
    """Return probabilities (m,) in float32, moved to that side of `cut` on which the label (m,) is."""
    middle = np.float32(cut)
    below, above = np.nextafter(middle, np.float32(0)), np.nextafter(middle, np.float32(1))
    found = np.asarray(p, dtype=np.float32)
    away = np.where(label == SUSPICIOUS, np.maximum(found, above), np.minimum(found, below))
    return np.asarray(away, dtype=np.float32)


def log_loss(difference: Floats, y: Floats, calibration: Calibration) -> float:
    """Return the mean negative log-probability of labels y (n,) in {-1, +1}, in nats."""
    return float(np.logaddexp(0.0, -y * calibration.log_odds(difference)).mean())


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


def operating_points(difference: Floats, y: Floats) -> Floats:
    """Return false alarms, thresholds and recall (k, 3) for each of `SHARES`.

    `difference` and `y` (n,): differences of min-marginals of patches that no model had seen, and their labels in {-1,
    +1}. The threshold is the least at which no larger share of the plausible ones is called suspicious. None without
    both labels.
    """
    plausible = np.sort(difference[y < 0.0])[::-1]
    suspicious = difference[y > 0.0]
    if len(plausible) == 0 or len(suspicious) == 0:
        return np.zeros((0, 3))
    rows = []
    for share in SHARES:
        allowed = min(int(np.floor(share * len(plausible) + 1e-9)), len(plausible) - 1)
        threshold = float(np.nextafter(plausible[allowed], np.inf))
        rows.append((share, threshold, float(np.mean(suspicious >= threshold))))
    return np.array(rows)


def with_false_alarms(model: Model, share: float, where: str) -> Model:
    """Return the model with the most sensitive threshold that keeps false alarms at or below a share.

    `share`: of plausible patches that may be called suspicious, as counted on regions kept out of training. The next
    smaller one of the model's points counts. `where`: the model's name, for messages. Raises UsageError if the model
    has no operating points.
    """
    if len(model.operating) == 0:
        raise UsageError(
            f"{where} has no operating points: no region was kept out when it was trained. Train on more regions with "
            "labels of both kinds, or leave out --max-false-alarms."
        )
    allowed = np.flatnonzero(model.operating[:, 0] <= share + 1e-12)
    return replace(model, threshold=float(model.operating[allowed[-1], 1]))
