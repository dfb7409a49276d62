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
def share_in(moments: Ints, n: int, seen: Ints, reach: int) -> float:
    """Share of n moments within `reach` of which `seen` is marked."""
    hits = 0
    for k in range(n):
        near = False
        for at in range(max(moments[k] - reach, 0), min(moments[k] + reach + 1, len(seen))):
            near = near or seen[at] > 0
        if near:
            hits += 1
    return hits / n


@jit
def seen_together(
    sheets: Sheets, planes: Planes, points: Floats, start: Ints, pairs: Ints, moment: Ints, reach: int
) -> Floats:
    """How far (n,) both patches of a pair were seen at the same moments, where they lie over one another; nan if not.

    The share of the covered points of either whose moment is one of the other's covered points, to within `reach`; of
    both shares the larger. Moments (k,) of the points are numbered from 0.
    """
    out = np.full(len(pairs), np.nan)
    longest = 0
    for i in range(len(start) - 1):
        longest = max(longest, start[i + 1] - start[i])
    found = np.zeros((2, longest), np.int64)
    seen = np.zeros(moment.max() + 1 if len(moment) > 0 else 1, np.int64)
    counts = np.zeros(2, np.int64)
    for p in range(len(pairs)):
        for side in range(2):
            counts[side] = covered_moments(
                sheets, planes, points, start, moment, pairs[p, side], pairs[p, 1 - side], found[side]
            )
        if counts[0] == 0 or counts[1] == 0:
            continue
        share = 0.0
        for side in range(2):
            for k in range(counts[side]):
                seen[found[side, k]] = 1
            share = max(share, share_in(found[1 - side], counts[1 - side], seen, reach))
            for k in range(counts[side]):
                seen[found[side, k]] = 0
        out[p] = share
    return out
