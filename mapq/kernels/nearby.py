"""All points of a cloud near a patch, whether they belong to it or not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import part
from mapq.kernels.sheets import Sheets
from mapq.kernels.voxels import EMPTY, find, key_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Nearby(NamedTuple):
    """All points (n,) of a cloud, voxel after voxel."""

    points: Floats  # (n, 3)
    moment: Ints  # (n,) from 0
    patch: Ints  # (n,) -1 for none
    to_sensor: Floats  # (n, 3), zero where it is not known
    key: Ints  # (v,) of the voxels
    first: Ints  # (v + 1,) number of each voxel's first point
    table: Ints  # places of keys
    side: float  # metres


@part
def cell_over(sheets: Sheets, i: int, u: float, v: float) -> int:
    """Cell of patch i, from 0, at the place (u, v) of its plane; `EMPTY` where there are no points of it."""
    column = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i]))
    row = int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i]))
    if column < 0 or row < 0 or column >= sheets.size[i, 0] or row >= sheets.size[i, 1]:
        return EMPTY
    cell = row * sheets.size[i, 0] + column
    at = sheets.base[i] + cell
    return cell if sheets.first[at + 1] > sheets.first[at] else EMPTY


@part
def voxels_about(nearby: Nearby, points: Floats, begin: int, end: int, mark: int, marks: Ints, found: Ints) -> int:
    """Write the places of the voxels in which points of a patch lie, and of those beside; how many.

    A voxel is written once: `marks` (v,) remembers the number of the patch, `mark`, that did so last.
    """
    n, last = 0, EMPTY
    for k in range(begin, end):
        x = int(np.floor(points[k, 0] / nearby.side))
        y = int(np.floor(points[k, 1] / nearby.side))
        z = int(np.floor(points[k, 2] / nearby.side))
        here = key_of(x, y, z)
        if here == last:
            continue
        last = here
        for number in range(27):
            beside = key_of(x + number % 3 - 1, y + number // 3 % 3 - 1, z + number // 9 - 1)
            place = find(nearby.key, nearby.table, beside)
            if place != EMPTY and marks[place] != mark:
                marks[place] = mark
                found[n] = place
                n += 1
    return n
