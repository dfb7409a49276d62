"""Rays that pass through patches: a walk through voxels from each sensor to its point (Amanatides and Woo 1987)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.frames import Planes, dot_from
from mapq.kernels.voxels import EMPTY, find, key_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GRAZING = 0.1
"""Cosine of the angle to a patch's normal below which a ray says nothing: it runs along the patch."""


class Voxels(NamedTuple):
    """Occupied voxels: keys (v,), the patch of each and the pass that saw it; and a hash table of their places."""

    key: Ints
    patch: Ints
    seen_by: Ints
    table: Ints
    side: float


@part
def passes_through(planes: Planes, patch: int, origin: Floats, hit: Floats, margin: float, q: Floats) -> bool:
    """Whether a ray crosses the plane of a patch and goes on beyond it by the margin; where, in q."""
    before, after = dot_from(planes.normal[patch], origin, planes.centre[patch]), 0.0
    after = dot_from(planes.normal[patch], hit, planes.centre[patch])
    if before * after >= 0.0 or abs(after) <= margin or abs(before) <= margin:
        return False
    length = 0.0
    for axis in range(3):
        length += (hit[axis] - origin[axis]) ** 2
    if abs(before - after) < GRAZING * np.sqrt(length):
        return False
    share = before / (before - after)
    for axis in range(3):
        q[axis] = origin[axis] + share * (hit[axis] - origin[axis])
    return True


@jit
def count_rays(
    voxels: Voxels, planes: Planes, origin: Floats, hit: Floats, seen_by: Ints, margin: float, counts: Ints
) -> None:
    """Count the rays that go through each occupied voxel and its patch: ``counts[v, 0]`` of its own pass, 1 of others.

    Rays go from origins (n, 3) to hits (n, 3); `seen_by` (n,) is their pass. A ray counts for a voxel in which it
    crosses the plane of the voxel's patch and beyond which it goes on by the margin.
    """
    cell, end, step = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3, np.int64)
    ahead, stride, q = np.zeros(3), np.zeros(3), np.zeros(3)
    side = voxels.side
    for r in range(len(origin)):
        total = 0
        for axis in range(3):
            cell[axis], end[axis] = int(np.floor(origin[r, axis] / side)), int(np.floor(hit[r, axis] / side))
            away = hit[r, axis] - origin[r, axis]
            step[axis] = 1 if away >= 0.0 else -1
            stride[axis] = side / abs(away) if away != 0.0 else np.inf
            border = (cell[axis] + (1 if away >= 0.0 else 0)) * side
            ahead[axis] = (border - origin[r, axis]) / away if away != 0.0 else np.inf
            total += abs(end[axis] - cell[axis])
        for _ in range(total + 1):
            place = find(voxels.key, voxels.table, key_of(cell[0], cell[1], cell[2]))
            if place != EMPTY and passes_through(planes, voxels.patch[place], origin[r], hit[r], margin, q):
                here = key_of(int(np.floor(q[0] / side)), int(np.floor(q[1] / side)), int(np.floor(q[2] / side)))
                if here == voxels.key[place]:
                    counts[place, 0 if voxels.seen_by[place] == seen_by[r] else 1] += 1
            axis = 0
            if ahead[1] < ahead[axis]:
                axis = 1
            if ahead[2] < ahead[axis]:
                axis = 2
            cell[axis] += step[axis]
            ahead[axis] += stride[axis]
