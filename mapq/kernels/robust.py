"""Planes through a point that not all of its neighbours lie on: beside a crossing, or between two copies of a wall.

Candidates are the planes through the point and two of its neighbours, taken by a fixed pattern; the best is fitted anew
to the points that lie near it. No random numbers, so that a point's plane depends on nothing but its neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.planes import MOMENTS, add_moments, fit_plane

REFITS = 3
NARROW = 0.25
"""Squared sine of the angle at the point below which two neighbours say too little about a plane (30 degrees)."""


@part
def local_points(xyz: NDArray[np.float64], i: int, neighbours: NDArray[np.int32], local: NDArray[np.float64]) -> int:
    """Copy a point and its neighbours relative to the point; return how many."""
    local[0] = 0.0
    n_local = 1
    for j in neighbours:
        if j < 0:
            break
        for axis in range(3):
            local[n_local, axis] = xyz[j, axis] - xyz[i, axis]
        n_local += 1
    return n_local


@part
def candidate(local: NDArray[np.float64], n_local: int, turn: int, plane: NDArray[np.float64]) -> bool:
    """Write plane number `turn` through the point and two neighbours; False where they lie nearly on a line."""
    n_others = n_local - 1
    a = turn % n_others
    b = (a + n_others // 3 + (turn // n_others) * (1 + n_others // 5)) % n_others
    u, v = local[1 + a], local[1 + b]
    nx, ny, nz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    squared = nx * nx + ny * ny + nz * nz
    lengths = (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if squared <= NARROW * lengths:
        return False
    length = np.sqrt(squared)
    plane[0], plane[1], plane[2], plane[3] = nx / length, ny / length, nz / length, 0.0
    return True


@part
def residuals(local: NDArray[np.float64], n_local: int, plane: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Write the distances of the local points to a plane."""
    for c in range(n_local):
        out[c] = abs(plane[0] * local[c, 0] + plane[1] * local[c, 1] + plane[2] * local[c, 2] - plane[3])


@part
def fit_within(
    local: NDArray[np.float64],
    residual: NDArray[np.float64],
    n_local: int,
    limit: float,
    sums: NDArray[np.float64],
    plane: NDArray[np.float64],
    spread: NDArray[np.float64],
) -> int:
    """Fit the plane to the points within `limit` of the last one; return how many they are."""
    sums[:] = 0.0
    for c in range(n_local):
        if residual[c] <= limit:
            add_moments(sums, local[c, 0], local[c, 1], local[c, 2])
    if sums[0] >= 3.0:
        fit_plane(sums, plane, spread)
    return np.int64(sums[0])


@part
def smallest(values: NDArray[np.float64], n: int, kept: int, sorted_: NDArray[np.float64]) -> float:
    """Return the number `kept` in the order of size of the first n values."""
    n_sorted = 0
    for c in range(n):
        if n_sorted == kept and values[c] >= sorted_[kept - 1]:
            continue
        at = min(n_sorted, kept - 1)
        while at > 0 and values[c] < sorted_[at - 1]:
            sorted_[at] = sorted_[at - 1]
            at -= 1
        sorted_[at] = values[c]
        n_sorted = min(n_sorted + 1, kept)
    return sorted_[n_sorted - 1]


@jit
def trimmed_residuals(
    xyz: NDArray[np.float64],
    points: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    turns: int,
    scale: NDArray[np.float64],
    residual: NDArray[np.float64],
) -> None:
    """Write each point's distances (s, k + 1) to the plane that holds half of its neighbourhood best, and their scale.

    Least quantile of squares (Rousseeuw 1984) over the candidates, then refits to the nearest half. The scale is the
    root mean square of that half, nan where there is no plane. It needs no noise to be known, so noise can be
    estimated by it, and half of the points may belong to another surface.
    """
    k = neighbours.shape[1]
    local, values, order = np.empty((k + 1, 3)), np.empty(k + 1), np.empty(k + 1)
    plane, best, sums, spread = np.empty(4), np.empty(4), np.empty(MOMENTS), np.empty(3)
    for s in range(len(points)):
        n_local = local_points(xyz, points[s], neighbours[s], local)
        scale[s] = np.nan
        residual[s] = np.nan
        kept, lowest = n_local // 2, np.inf
        if kept < 4:
            continue
        for turn in range(turns):
            if candidate(local, n_local, turn, plane):
                residuals(local, n_local, plane, values)
                quantile = smallest(values, n_local, kept, order)
                if quantile < lowest:
                    lowest = quantile
                    best[:] = plane
        if lowest == np.inf:
            continue
        for _ in range(REFITS):
            residuals(local, n_local, best, values)
            fit_within(local, values, n_local, smallest(values, n_local, kept, order), sums, best, spread)
        residuals(local, n_local, best, values)
        smallest(values, n_local, kept, order)
        total = 0.0
        for c in range(kept):
            total += order[c] * order[c]
        scale[s] = np.sqrt(total / kept)
        residual[s, :n_local] = values[:n_local]


@jit
def robust_normals(
    xyz: NDArray[np.float64],
    points: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    turns: int,
    band: float,
    min_share: float,
    normal: NDArray[np.float32],
    variance: NDArray[np.float32],
) -> None:
    """Write normals (n, 3) of some points anew, from those of their neighbours that lie near one plane with them.

    The best candidate has the most points within `band` (weighted 1 - (r / band)^2: MSAC, Torr and Zisserman 2000). A
    point of which less than `min_share` of the neighbourhood lies on its plane gets nan: there is none. `variance`
    gets the variance across the plane.
    """
    k = neighbours.shape[1]
    local, values = np.empty((k + 1, 3)), np.empty(k + 1)
    plane, best, sums, spread = np.empty(4), np.empty(4), np.empty(MOMENTS), np.empty(3)
    for s in range(len(points)):
        i = points[s]
        n_local = local_points(xyz, i, neighbours[s], local)
        highest = 0.0
        for turn in range(turns if n_local > 4 else 0):
            if candidate(local, n_local, turn, plane):
                score = 0.0
                for c in range(n_local):
                    r = plane[0] * local[c, 0] + plane[1] * local[c, 1] + plane[2] * local[c, 2]
                    score += max(1.0 - r * r / (band * band), 0.0)
                if score > highest:
                    highest = score
                    best[:] = plane
        n_near = 0
        for _ in range(REFITS if highest > 0.0 else 0):
            residuals(local, n_local, best, values)
            n_near = fit_within(local, values, n_local, band, sums, best, spread)
        if n_near < max(min_share * n_local, 4.0) or abs(best[3]) > band:
            normal[i] = np.nan
            variance[i] = np.nan
            continue
        variance[i] = spread[0]
        for axis in range(3):
            normal[i, axis] = best[axis]
