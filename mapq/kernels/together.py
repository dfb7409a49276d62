"""Whether two patches that lie over one another were seen at the same moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.cover import is_covered
from mapq.kernels.frames import Planes, dot_from
from mapq.kernels.sheets import Sheets

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@part
def covered_moments(
    sheets: Sheets, planes: Planes, points: Floats, start: Ints, moment: Ints, i: int, j: int, found: Ints
) -> int:
    """Write the moments of the points of patch i that patch j covers; how many."""
    n = 0
    for k in range(start[i], start[i + 1]):
        at = sheets.number[k]
        u = dot_from(planes.across[j], points[at], planes.centre[j])
        v = dot_from(planes.along[j], points[at], planes.centre[j])
        if is_covered(sheets, j, u, v):
            found[n] = moment[at]
            n += 1
    return n


@part
def within(counts: Ints, moment: int, reach: int) -> int:
    """How many are counted at moments within `reach` of one."""
    total = 0
    for at in range(max(moment - reach, 0), min(moment + reach + 1, len(counts))):
        total += counts[at]
    return total


@part
def share_in(moments: Ints, n: int, own: Ints, others: Ints, n_others: int, reach: int) -> float:
    """Mean over n points of how far the others, too, were seen at the point's moment: never more than in full.

    Without reach it is what the histograms of both have in common. A few points that strayed into a copy from the wall
    beside it do not make the copy seen together with it.
    """
    total = 0.0
    for k in range(n):
        mine = within(own, moments[k], reach) / n
        total += min(within(others, moments[k], reach) / n_others / mine, 1.0)
    return total / n


@jit
def seen_together(
    sheets: Sheets, planes: Planes, points: Floats, start: Ints, pairs: Ints, moment: Ints, reach: int
) -> Floats:
    """How far (n,) both patches of a pair were seen at the same moments, where they lie over one another; nan if not.

    Each covered point of either counts by how common moments within `reach` of its own are among the other's covered
    points, in times how common they are among its own, at most 1; of both means the larger. Moments (k,) of the points
    are numbered from 0.
    """
    out = np.full(len(pairs), np.nan)
    longest = 0
    for i in range(len(start) - 1):
        longest = max(longest, start[i + 1] - start[i])
    found = np.zeros((2, longest), np.int64)
    seen = np.zeros((2, moment.max() + 1 if len(moment) > 0 else 1), np.int64)
    counts = np.zeros(2, np.int64)
    for p in range(len(pairs)):
        for side in range(2):
            counts[side] = covered_moments(
                sheets, planes, points, start, moment, pairs[p, side], pairs[p, 1 - side], found[side]
            )
        if counts[0] == 0 or counts[1] == 0:
            continue
        for side in range(2):
            for k in range(counts[side]):
                seen[side, found[side, k]] += 1
        share = 0.0
        for side in range(2):
            other = 1 - side
            share = max(share, share_in(found[side], counts[side], seen[side], seen[other], counts[other], reach))
        for side in range(2):
            for k in range(counts[side]):
                seen[side, found[side, k]] = 0
        out[p] = share
    return out
