"""From metres of disagreement to the labels of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED


@dataclass(frozen=True)
class Rule:
    """Which points are suspicious, and which plausible.

    Attributes
    ----------
    suspicious_above, plausible_below : float
        Metres of disagreement along the normal; between them points are ambiguous.
    reach : float or None
        Metres along a surface within which two scans see the same part of it; None: estimated.
    search : float
        Metres by which scans may lie off each other where no right poses are known.
    """

    suspicious_above: float = 0.3
    plausible_below: float = 0.1
    reach: float | None = None
    search: float = 3.0


def label_points(metres: NDArray[np.float64], rule: Rule) -> NDArray[np.uint8]:
    """Return the label (n,) of each point: suspicious, plausible, or `UNLABELLED` where ambiguous or not known."""
    with np.errstate(invalid="ignore"):
        label = np.where(metres > rule.suspicious_above, SUSPICIOUS, UNLABELLED)
        label[metres <= rule.plausible_below] = PLAUSIBLE
    return label.astype(np.uint8)
