"""Voxels: hash tables of their keys, and the points of a cloud in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.voxels import Nearby, fill_table, voxel_keys
from mapq.patches import Patches

FARTHEST = 1.5
"""Metres off its plane up to which points lie over a patch."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def table_of(key: Ints) -> Ints:
    """Return the hash table of the places of distinct keys (v,)."""
    table = np.empty(1 << int(2 * len(key)).bit_length(), np.int64)
    fill_table(key, table)
    return table


def nearby_points(patches: Patches, number: Ints, moment: Ints, to_sensor: Floats | None) -> Nearby:
    """Return points of a cloud in voxels as wide as anything over a patch may be off it, there by place and moment.

    `number` (n,): which points of the cloud: all finite ones. `moment` (n,): from 0. `to_sensor` (n, 3).
    """
    points = np.asarray(patches.cloud.xyz[number], np.float64)
    key = voxel_keys(points, FARTHEST)
    order = np.lexsort((points[:, 0], key))
    # The other coordinates decide where this leaves a tie: sorting all by all of them takes three times as long.
    same = (np.diff(key[order]) == 0) & (np.diff(points[order, 0]) == 0.0)
    tied = np.append(same, False) | np.append(False, same) if len(order) else np.zeros(0, bool)
    some = order[tied]
    order[tied] = some[np.lexsort((moment[some], *points[some].T, key[some]))]
    distinct, first = np.unique(key[order], return_index=True)
    towards = np.zeros_like(points) if to_sensor is None else np.nan_to_num(to_sensor[order])
    first = np.append(first, len(order)).astype(np.int64)
    numbers = patches.patch[number[order]].astype(np.int64)
    return Nearby(points[order], moment[order], numbers, towards, distinct, first, table_of(distinct), FARTHEST)
