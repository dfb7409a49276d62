"""Whether two patches cross one another, and how far from their edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.boxes import Trees
from mapq.kernels.order import quantile
from mapq.kernels.overlap import Planes, dot

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOW, HIGH = 0.02, 0.98
"""Quantiles that stand for the edges of a patch: growing regions leave a few points beyond them."""
PARALLEL = 1e-6
"""Sine below which there is no line of intersection in float64; noise ends the crossing long before."""


@part
def line_places(trees: Trees, planes: Planes, i: int, j: int, line: Floats, sine: float, t: Floats, s: Floats) -> int:
    """Place of each point of patch i in its plane: t across the line where plane j cuts it, s along; how many.

    Across, it is the point's height over plane j once put on plane i, over the sine of their angle.
    """
    n = trees.start[i + 1] - trees.start[i]
    ni, nj = planes.normal[i], planes.normal[j]
    cosine = dot(ni, nj)
    for k in range(n):
        point = trees.points[trees.start[i] + k]
        height = dot(nj, point - planes.centre[j]) - cosine * dot(ni, point - planes.centre[i])
        t[k] = height / sine
        s[k] = dot(line, point - planes.centre[i])
    return n


@part
def keep_between(t: Floats, s: Floats, n: int, low: float, high: float) -> int:
    """Move the places with s from `low` to `high` to the front; how many."""
    kept = 0
    for k in range(n):
        if low <= s[k] <= high:
            t[kept], s[kept] = t[k], s[k]
            kept += 1
    return kept


@part
def edge_ratio(t: Floats, n: int, slack: float) -> float:
    """Nearer over farther edge distance from the line, both less `slack`; 0 unless it lies between the edges."""
    if n == 0:
        return 0.0
    low, high = -quantile(t, n, LOW), quantile(t, n, HIGH)
    near, far = min(low, high) - slack, max(low, high) - slack
    return near / far if near > 0.0 else 0.0


@part
def ratio_between(
    trees: Trees,
    planes: Planes,
    pair: Ints,
    line: Floats,
    sine: float,
    slack: float,
    t: Floats,
    s: Floats,
    span: Floats,
) -> float:
    """Smaller edge ratio of both patches, each over the stretch of the line along which both lie (span: from, to)."""
    ratio = 1.0
    shift = dot(line, planes.centre[pair[0]] - planes.centre[pair[1]])
    for side in range(2):
        i, j = pair[side], pair[1 - side]
        move = shift if side == 1 else 0.0
        n = line_places(trees, planes, i, j, line, sine, t, s)
        n = keep_between(t, s, n, span[0] + move, span[1] + move)
        ratio = min(ratio, edge_ratio(t, n, slack))
        if ratio == 0.0:
            break
    return ratio


@part
def crossing(
    trees: Trees,
    planes: Planes,
    pair: Ints,
    line: Floats,
    sine: float,
    spacing: float,
    noise: float,
    t: Floats,
    s: Floats,
) -> float:
    """R of one pair, the patch with fewer points first: it alone settles most pairs."""
    slack = spacing + 2.0 * noise / sine
    span = np.array([-np.inf, np.inf])
    shift = dot(line, planes.centre[pair[0]] - planes.centre[pair[1]])
    for side in range(2):
        n = line_places(trees, planes, pair[side], pair[1 - side], line, sine, t, s)
        if edge_ratio(t, n, slack) == 0.0:
            return 0.0
        move = shift if side == 1 else 0.0
        span[0] = max(span[0], quantile(s, n, LOW) - move)
        span[1] = min(span[1], quantile(s, n, HIGH) - move)
    if span[1] - span[0] <= spacing:
        return 0.0
    return ratio_between(trees, planes, pair, line, sine, slack, t, s, span)


@jit
def crossings(trees: Trees, planes: Planes, pairs: Ints, spacing: Floats, noise: float) -> Floats:
    """R (n,) of each pair: 1 where the patches cross in their middles, 0 at an edge of either, or if they do not.

    Slack for either edge is ``spacing + 2 noise / sine``: by so much the line, or a region growing over it, may be off.
    """
    out = np.zeros(len(pairs))
    longest = 0
    for i in range(len(trees.start) - 1):
        longest = max(longest, trees.start[i + 1] - trees.start[i])
    t, s, line = np.zeros(longest), np.zeros(longest), np.zeros(3)
    for k in range(len(pairs)):
        ni, nj = planes.normal[pairs[k, 0]], planes.normal[pairs[k, 1]]
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            line[axis] = ni[b] * nj[c] - ni[c] * nj[b]
        sine = np.sqrt(dot(line, line))
        if sine > PARALLEL:
            line /= sine
            out[k] = crossing(trees, planes, pairs[k], line, sine, spacing[k], noise, t, s)
    return out
