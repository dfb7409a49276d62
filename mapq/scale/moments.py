"""Moments of sets of points about other origins: sums of parts of a map add up about a common one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def translate(sums: Floats, origin: Floats, to: Floats) -> Floats:
    """Return moments (m, 10) about origins (m, 3) as they are about others (m, 3)."""
    n, x = sums[:, :1], origin - to
    linear = sums[:, 1:4]
    out = np.empty_like(sums)
    out[:, :1] = n
    out[:, 1:4] = linear + n * x
    for place, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), 4):
        mixed = x[:, a] * linear[:, b] + x[:, b] * linear[:, a]
        out[:, place] = sums[:, place] + mixed + sums[:, 0] * x[:, a] * x[:, b]
    return out
