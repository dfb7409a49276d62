"""Region growing: planes that take in neighbour after neighbour as long as it lies on them and faces as they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.planes import MOMENTS, add_moments, fit_plane

FREE = -1
REFIT_GROWTH = 1.1
"""A region's plane is fitted anew whenever it has grown by a tenth: at most 2.5 times a doubling is not enough to let a
young plane lean, and each point still costs less for refits than for its neighbours."""


@part
def grow_one(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    normal: NDArray[np.float32],
    seed: int,
    number: int,
    cos_angle: float,
    max_distance: float,
    region: NDArray[np.int32],
    queue: NDArray[np.int32],
    sums: NDArray[np.float64],
    plane: NDArray[np.float64],
    spread: NDArray[np.float64],
) -> int:
    """Grow one region from `seed`; return its size, the length of `queue` that lists it."""
    plane[0], plane[1], plane[2], plane[3] = normal[seed, 0], normal[seed, 1], normal[seed, 2], 0.0
    sums[:] = 0.0
    x0, y0, z0 = xyz[seed, 0], xyz[seed, 1], xyz[seed, 2]
    queue[0] = seed
    region[seed] = number
    n_members, head, refit_at = 1, 0, 8.0
    add_moments(sums, 0.0, 0.0, 0.0)
    while head < n_members:
        i = queue[head]
        head += 1
        for j in neighbours[i]:
            if j < 0:
                break
            if region[j] != FREE:
                continue
            # Normals first: most of those that are turned away are known by them, from half as much memory.
            if not abs(plane[0] * normal[j, 0] + plane[1] * normal[j, 1] + plane[2] * normal[j, 2]) >= cos_angle:
                continue
            x, y, z = xyz[j, 0] - x0, xyz[j, 1] - y0, xyz[j, 2] - z0
            if abs(plane[0] * x + plane[1] * y + plane[2] * z - plane[3]) > max_distance:
                continue
            region[j] = number
            queue[n_members] = j
            n_members += 1
            add_moments(sums, x, y, z)
        if n_members >= refit_at:
            fit_plane(sums, plane, spread)
            refit_at = REFIT_GROWTH * n_members
    return n_members


@jit
def grow_regions(
    xyz: NDArray[np.float64],
    neighbours: NDArray[np.int32],
    normal: NDArray[np.float32],
    seeds: NDArray[np.int64],
    cos_angle: float,
    max_distance: float,
    min_size: int,
    region: NDArray[np.int32],
) -> int:
    """Number the points of each region, seed after seed; return how many regions there are.

    A point joins if it is a neighbour of a member, its distance to the region's plane is at most `max_distance` and
    its normal is within the angle of the plane's. Points with a normal of nan neither join nor lead on, and are no
    seeds. What stays below `min_size` is free again.
    """
    queue = np.empty(len(xyz), np.int32)
    sums, plane, spread = np.empty(MOMENTS), np.empty(4), np.empty(3)
    n_regions = 0
    for seed in seeds:
        if region[seed] != FREE:
            continue
        n_members = grow_one(
            xyz,
            neighbours,
            normal,
            seed,
            n_regions,
            cos_angle,
            max_distance,
            region,
            queue,
            sums,
            plane,
            spread,
        )
        if n_members >= min_size:
            n_regions += 1
        else:
            for c in range(n_members):
                region[queue[c]] = FREE
    return n_regions
