"""Operating points: how many false alarms a threshold costs, and what it finds, on regions kept out of training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapq.model import Model
from prf.shell.errors import UsageError

SHARES = (
    *(0.0, 0.001, 0.002, 0.003, 0.005, 0.007),
    *(0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.08),
    *(0.1, 0.125, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5),
)
"""False alarms of the operating points that a model keeps."""


def operating_points(difference: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
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
