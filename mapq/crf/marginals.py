"""Probabilities of labels from differences of min-marginals, calibrated on held-out patches.

Min-marginals always agree with the best labelling, and trained ones are well calibrated (Tarlow and Adams 2012,
"Revisiting uncertainty in graph cut solutions"); marginals by belief propagation were wrong at strong coupling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import expit

from mapq.patches import SUSPICIOUS

TEMPERATURES = (1e-3, 1e3)
"""Bounds of the temperature: held-out patches whose differences are all 0 leave it free."""

_HALF = np.float32(0.5)
_BELOW, _ABOVE = np.nextafter(_HALF, np.float32(0)), np.nextafter(_HALF, np.float32(1))


def probabilities(difference: NDArray[np.float64], label: NDArray[np.uint8], temperature: float) -> NDArray[np.float32]:
    """Return the probability (m,) that a patch is suspicious: the logistic function of temperature times difference.

    In float32 and never exactly one half: it is above where the label is suspicious (ties included), below elsewhere.
    """
    found = np.asarray(expit(temperature * difference), dtype=np.float32)
    away = np.where(label == SUSPICIOUS, np.maximum(found, _ABOVE), np.minimum(found, _BELOW))
    return np.asarray(away, dtype=np.float32)


def log_loss(difference: NDArray[np.float64], y: NDArray[np.float64], temperature: float) -> float:
    """Return the mean negative log-probability of labels y (n,) in {-1, +1}, in nats."""
    return float(np.logaddexp(0.0, -temperature * y * difference).mean())


def fit_temperature(difference: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Return the temperature of least log-loss, searched on its logarithm between `TEMPERATURES`.

    Labels count as almost sure only, (n + 1) / (n + 2) for n patches of a label (Platt 1999, "Probabilistic outputs for
    support vector machines"), or patches that are all right would ask for an infinite temperature.
    """
    n_suspicious, n_plausible = np.count_nonzero(y > 0.0), np.count_nonzero(y < 0.0)
    sure = np.where(y > 0.0, (n_suspicious + 1.0) / (n_suspicious + 2.0), (n_plausible + 1.0) / (n_plausible + 2.0))
    low, high = np.log(TEMPERATURES)

    def loss(logarithm: float) -> float:
        margin = np.exp(logarithm) * y * difference
        return float(np.mean(sure * np.logaddexp(0.0, -margin) + (1.0 - sure) * np.logaddexp(0.0, margin)))

    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-6})
    return float(np.exp(found.x))
