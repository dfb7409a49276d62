"""What lies over a patch that was not seen together with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.frames import Planes, dot_from
from mapq.kernels.sheets import Sheets
from mapq.kernels.together import within
from mapq.kernels.voxels import EMPTY, find, key_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

IN_FULL = 0.5
"""A moment at which a patch was seen this often, in times how often what lies over it was, counts as one of both: with
few points of each the shares differ by chance."""


class Near(NamedTuple):
    """All points (n,) of a cloud, voxel after voxel."""

    points: Floats  # (n, 3)
    moment: Ints  # (n,) from 0
    patch: Ints  # (n,) -1 for none
    key: Ints  # (v,) of the voxels
    first: Ints  # (v + 1,) number of each voxel's first point
    table: Ints  # places of keys
    side: float  # metres


@part
def lies_over(sheets: Sheets, i: int, u: float, v: float) -> bool:
    """Whether there are points of patch i in the cell of the place (u, v) of its plane."""
    column = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i]))
    row = int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i]))
    if column < 0 or row < 0 or column >= sheets.size[i, 0] or row >= sheets.size[i, 1]:
        return False
    at = sheets.base[i] + row * sheets.size[i, 0] + column
    return sheets.first[at + 1] > sheets.first[at]


@part
def voxels_about(near: Near, points: Floats, begin: int, end: int, mark: int, marks: Ints, found: Ints) -> int:
    """Write the places of the voxels in which points of a patch lie, and of those beside; how many.

    A voxel is written once: `marks` (v,) remembers the number of the patch, `mark`, that did so last.
    """
    n, last = 0, EMPTY
    for k in range(begin, end):
        x = int(np.floor(points[k, 0] / near.side))
        y = int(np.floor(points[k, 1] / near.side))
        z = int(np.floor(points[k, 2] / near.side))
        here = key_of(x, y, z)
        if here == last:
            continue
        last = here
        for number in range(27):
            beside = key_of(x + number % 3 - 1, y + number // 3 % 3 - 1, z + number // 9 - 1)
            place = find(near.key, near.table, beside)
            if place != EMPTY and marks[place] != mark:
                marks[place] = mark
                found[n] = place
                n += 1
    return n


@part
def over_patch(
    near: Near, sheets: Sheets, planes: Planes, i: int, band: Floats, places: Ints, n_places: int, found: Ints
) -> int:
    """Write the moments of the points over patch i that lie off its plane by what the band says; how many."""
    n = 0
    for p in range(n_places):
        for k in range(near.first[places[p]], near.first[places[p] + 1]):
            height = abs(dot_from(planes.normal[i], near.points[k], planes.centre[i]))
            if near.patch[k] == i or height <= band[0] or height > band[1]:
                continue
            u = dot_from(planes.across[i], near.points[k], planes.centre[i])
            v = dot_from(planes.along[i], near.points[k], planes.centre[i])
            if lies_over(sheets, i, u, v):
                found[n] = near.moment[k]
                n += 1
    return n


@part
def share_together(over: Ints, counts: Ints, own: Ints, n_own: int, reach: int) -> float:
    """How far what lies over a patch was seen at the moments of its n_own points: mean over the points `over` (n,).

    Both counts are by moments. Moments are gone through in order, so that the sum does not depend on that of points.
    """
    over.sort()
    total, k = 0.0, 0
    while k < len(over):
        moment = over[k]
        theirs = within(counts, moment, reach) / len(over)
        mine = within(own, moment, reach) / n_own
        total += counts[moment] * min(mine / (IN_FULL * theirs), 1.0)
        k += counts[moment]
    return total / len(over)


@jit
def seen_apart(
    near: Near, sheets: Sheets, planes: Planes, points: Floats, start: Ints, moment: Ints, band: Floats, reach: int
) -> Floats:
    """Share (m,) of the points of each patch and over it that lie over it and were not seen together with it.

    Over it are points that lie off its plane by more than ``band[0]`` and at most ``band[1]`` metres, in its outline.
    Those were seen together with the patch whose moments within `reach` are among those of its own points, ``moment``
    (k,). In [0, 1]: n (1 - s) / (n + own), s the share that was seen together.
    """
    out = np.zeros(len(start) - 1)
    n_moments = 1
    for k in range(len(near.moment)):
        n_moments = max(n_moments, near.moment[k] + 1)
    own, counts = np.zeros(n_moments, np.int64), np.zeros(n_moments, np.int64)
    marks, places = np.full(len(near.key), EMPTY, np.int64), np.zeros(len(near.key), np.int64)
    found = np.zeros(len(near.points), np.int64)
    for i in range(len(out)):
        n_own = start[i + 1] - start[i]
        n_places = voxels_about(near, points, start[i], start[i + 1], i, marks, places)
        n = over_patch(near, sheets, planes, i, band, places, n_places, found)
        if n == 0:
            continue
        for k in range(start[i], start[i + 1]):
            own[moment[k]] += 1
        for k in range(n):
            counts[found[k]] += 1
        apart = 1.0 - share_together(found[:n], counts, own, n_own, reach)
        for k in range(start[i], start[i + 1]):
            own[moment[k]] = 0
        for k in range(n):
            counts[found[k]] = 0
        out[i] = apart * n / (n + n_own)
    return out
