"""Planes of patches, and the few vectors that kernels need."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import part

Floats = NDArray[np.float64]


class Planes(NamedTuple):
    """The plane of each patch: unit normal, a point of it, two unit vectors in it (m, 3 each); its area (m,)."""

    normal: Floats
    centre: Floats
    across: Floats
    along: Floats
    area: Floats


@part
def dot(a: Floats, b: Floats) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def dot_from(a: Floats, point: Floats, origin: Floats) -> float:
    """Scalar product of a and the ray from `origin` to `point`."""
    return a[0] * (point[0] - origin[0]) + a[1] * (point[1] - origin[1]) + a[2] * (point[2] - origin[2])


@part
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Vector product."""
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        out[axis] = a[one] * b[two] - a[two] * b[one]


@part
def normalise(a: Floats) -> None:
    """Make a unit vector of a."""
    length = np.sqrt(dot(a, a))
    for axis in range(3):
        a[axis] /= length
