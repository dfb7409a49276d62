"""How far scans disagree on a whole map, patches weighing by their area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def mean_by_area(metres: Floats, area: Floats) -> float:
    """Return the mean of numbers (m,) by areas (m,), of patches where both are known; nan of none."""
    known, weight = _known(metres, area)
    return float(known @ weight / weight.sum()) if weight.sum() else float("nan")


def median_by_area(metres: Floats, area: Floats) -> float:
    """Return the median of numbers (m,) by areas (m,), of patches where both are known; nan of none."""
    known, weight = _known(metres, area)
    if not weight.sum():
        return float("nan")
    order = np.argsort(known, kind="stable")
    total = np.cumsum(weight[order])
    return float(known[order[int(np.searchsorted(total, 0.5 * total[-1]))]])


def _known(metres: Floats, area: Floats) -> tuple[Floats, Floats]:
    known = np.isfinite(metres) & np.isfinite(area)
    return metres[known], area[known]
