"""Union of regions that are pieces of one plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.planes import MOMENTS, fit_plane


@part
def translate(
    sums: NDArray[np.float64], origin: NDArray[np.float64], to: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Write the moments of a set about another origin."""
    n, x, y, z = sums[0], origin[0] - to[0], origin[1] - to[1], origin[2] - to[2]
    out[0] = n
    out[1], out[2], out[3] = sums[1] + n * x, sums[2] + n * y, sums[3] + n * z
    out[4] = sums[4] + 2.0 * x * sums[1] + n * x * x
    out[5] = sums[5] + x * sums[2] + y * sums[1] + n * x * y
    out[6] = sums[6] + x * sums[3] + z * sums[1] + n * x * z
    out[7] = sums[7] + 2.0 * y * sums[2] + n * y * y
    out[8] = sums[8] + y * sums[3] + z * sums[2] + n * y * z
    out[9] = sums[9] + 2.0 * z * sums[3] + n * z * z


@part
def mean_square(sums: NDArray[np.float64], plane: NDArray[np.float64]) -> float:
    """Return the mean squared distance of a set to a plane."""
    nx, ny, nz, d = plane[0], plane[1], plane[2], plane[3]
    quadratic = nx * nx * sums[4] + ny * ny * sums[7] + nz * nz * sums[9]
    quadratic += 2.0 * (nx * ny * sums[5] + nx * nz * sums[6] + ny * nz * sums[8])
    linear = nx * sums[1] + ny * sums[2] + nz * sums[3]
    return max((quadratic - 2.0 * d * linear) / sums[0] + d * d, 0.0)


@part
def joint_rms(
    a: int,
    b: int,
    origin: NDArray[np.float64],
    sums: NDArray[np.float64],
    work: NDArray[np.float64],
    plane: NDArray[np.float64],
    spread: NDArray[np.float64],
) -> float:
    """Return how well one plane would do for two regions: the worse one's distance to it, root mean square."""
    translate(sums[b], origin[b], origin[a], work[0])
    for c in range(MOMENTS):
        work[1, c] = sums[a, c] + work[0, c]
    fit_plane(work[1], plane, spread)
    return np.sqrt(max(mean_square(sums[a], plane), mean_square(work[0], plane)))


@part
def root_of(parent: NDArray[np.int32], r: int) -> int:
    """Return the region that r has gone into."""
    while parent[r] != r:
        parent[r] = parent[parent[r]]
        r = parent[r]
    return r


@jit
def pair_rms(
    pairs: NDArray[np.int32], parent: NDArray[np.int32], origin: NDArray[np.float64], sums: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return :func:`joint_rms` of each pair of regions as they are now; inf for pairs that are one already."""
    out = np.empty(len(pairs))
    out[:] = np.inf
    work, plane, spread = np.empty((2, MOMENTS)), np.empty(4), np.empty(3)
    for p in range(len(pairs)):
        a, b = root_of(parent, pairs[p, 0]), root_of(parent, pairs[p, 1])
        if a != b and sums[a, 0] >= 3.0 and sums[b, 0] >= 3.0:
            out[p] = joint_rms(min(a, b), max(a, b), origin, sums, work, plane, spread)
    return out


@jit
def unite(
    pairs: NDArray[np.int32],
    parent: NDArray[np.int32],
    origin: NDArray[np.float64],
    sums: NDArray[np.float64],
    max_rms: float,
) -> int:
    """Unite pairs in the order given as long as one plane still does for both; return how many were united.

    The region of the smaller number takes the other in: `parent` and `sums` are updated.
    """
    n_united = 0
    work, plane, spread = np.empty((2, MOMENTS)), np.empty(4), np.empty(3)
    for p in range(len(pairs)):
        a, b = root_of(parent, pairs[p, 0]), root_of(parent, pairs[p, 1])
        if a == b:
            continue
        a, b = min(a, b), max(a, b)
        if joint_rms(a, b, origin, sums, work, plane, spread) <= max_rms:
            parent[b] = a
            for c in range(MOMENTS):
                sums[a, c] = work[1, c]
            n_united += 1
    return n_united


@jit
def resolve(parent: NDArray[np.int32]) -> None:
    """Point every region straight to the one that it has gone into."""
    for r in range(len(parent)):
        parent[r] = root_of(parent, r)
