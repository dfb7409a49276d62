"""Between which bounds parameters of sensors lie: beyond them doubles overflow, or a density has no logarithm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

LARGEST_COORDINATE = 1e8
"""Metres. Beyond any projected map (1e7), and small enough that millimetres survive in double precision."""
LARGEST_RANGE = 1e6
"""Metres. Beyond any sensor, and far below what drivers write for no return, such as the largest float."""

MIN_LENGTH = 1e-9  # metres, far below what any sensor resolves
MAX_FACTOR = 1e6  # of log odds, of their slopes and of noise as a share of the distance
MIN_PROBABILITY = 1e-100
LENGTH: dict[str, Any] = {"ge": MIN_LENGTH, "le": LARGEST_RANGE}
FACTOR: dict[str, Any] = {"ge": -MAX_FACTOR, "le": MAX_FACTOR}
"""Constraints of such fields of a table."""


def window_fault(bounds: Sequence[float]) -> str:
    """Return in words what is wrong with bounds x_min, y_min, x_max, y_max of a window; empty if nothing is."""
    if not all(math.isfinite(bound) for bound in bounds):
        return "every bound must be finite. Give X0 Y0 X1 Y1 in metres"
    if max(map(abs, bounds)) > LARGEST_COORDINATE:
        return f"a bound lies beyond {LARGEST_COORDINATE:g} m. Use a local origin"
    return "" if bounds[0] < bounds[2] and bounds[1] < bounds[3] else "needs X0 < X1 and Y0 < Y1"
