"""Probabilities of labels from differences of min-marginals.

Min-marginals always agree with the best labelling, and trained ones are well calibrated (Tarlow and Adams 2012,
"Revisiting uncertainty in graph cut solutions"); marginals by belief propagation were wrong at strong coupling.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mapq.model import Calibration, Model
from mapq.patches import SUSPICIOUS


def probabilities(difference: NDArray[np.float64], label: NDArray[np.uint8], model: Model) -> NDArray[np.float32]:
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


def keep_sides(p: NDArray[np.float64], label: NDArray[np.uint8], cut: float = 0.5) -> NDArray[np.float32]:
    """Return probabilities (m,) in float32, moved to that side of `cut` on which the label (m,) is."""
    middle = np.float32(cut)
    below, above = np.nextafter(middle, np.float32(0)), np.nextafter(middle, np.float32(1))
    found = np.asarray(p, dtype=np.float32)
    away = np.where(label == SUSPICIOUS, np.maximum(found, above), np.minimum(found, below))
    return np.asarray(away, dtype=np.float32)


def log_loss(difference: NDArray[np.float64], y: NDArray[np.float64], calibration: Calibration) -> float:
    """Return the mean negative log-probability of labels y (n,) in {-1, +1}, in nats."""
    return float(np.logaddexp(0.0, -y * calibration.log_odds(difference)).mean())
