"""Normals of points from their neighbours, and how flat the neighbourhood is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit
from mapq.kernels.planes import MOMENTS, add_moments, fit_plane


@jit
def estimate_normals(
    xyz: NDArray[np.float64],
    points: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    normal: NDArray[np.float32],
    spread: NDArray[np.float32],
) -> None:
    """Write the normal (s, 3) of the plane through each of some points and its neighbours, and their variances (s, 3).

    Variances are biased and ascend: across the plane, and along its short and its long side. Neighbours end at the
    first -1; a point with fewer than two gets a normal of nan.
    """
    sums, plane, variance = np.empty(MOMENTS), np.empty(4), np.empty(3)
    for s in range(len(points)):
        i = points[s]
        sums[:] = 0.0
        sums[0] = 1.0
        for j in neighbours[s]:
            if j < 0:
                break
            add_moments(sums, xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2])
        if sums[0] < 3.0:
            for axis in range(3):
                normal[s, axis] = np.nan
                spread[s, axis] = np.nan
            continue
        fit_plane(sums, plane, variance)
        for axis in range(3):
            normal[s, axis] = plane[axis]
            spread[s, axis] = variance[axis]
