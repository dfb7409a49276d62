"""Whether two patches cross one another, and how far from their edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.boxes import Trees
from mapq.kernels.frames import Planes, cross, dot, dot_from, normalise
from mapq.kernels.order import quantile

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
        height = dot_from(nj, point, planes.centre[j]) - cosine * dot_from(ni, point, planes.centre[i])
        t[k] = height / sine
        s[k] = dot_from(line, point, planes.centre[i])
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
def crossing(
    trees: Trees,
    planes: Planes,
    pair: Ints,
    line: Floats,
    sine: float,
    spacing: float,
    beyond: float,
    t: Floats,
    s: Floats,
) -> float:
    """R of one pair: the smaller edge ratio of both, over the stretch of the line along which both lie.

    First each patch as a whole, which settles most pairs, then the part of it along the common stretch; the patch with
    fewer points first.
    """
    slack = spacing + beyond / sine
    shift = dot_from(line, planes.centre[pair[0]], planes.centre[pair[1]])
    low, high, smallest = -np.inf, np.inf, 1.0
    for step in range(4):
        side = step % 2
        move = shift if side == 1 else 0.0
        n = line_places(trees, planes, pair[side], pair[1 - side], line, sine, t, s)
        if step >= 2:
            n = keep_between(t, s, n, low + move, high + move)
        ratio = edge_ratio(t, n, slack)
        if ratio == 0.0:
            return 0.0
        if step < 2:
            low, high = max(low, quantile(s, n, LOW) - move), min(high, quantile(s, n, HIGH) - move)
        else:
            smallest = min(smallest, ratio)
        if high - low <= spacing:
            return 0.0
    return smallest


@jit
def crossings(trees: Trees, planes: Planes, pairs: Ints, spacing: Floats, beyond: float) -> Floats:
    """R (n,) of each pair: 1 where the patches cross in their middles, 0 at an edge of either, or if they do not.

    Each must reach beyond the plane of the other by the distance `beyond`, on both sides: less than that noise, or a
    region that grows over its edge, explains. The point spacing is slack too.
    """
    out = np.zeros(len(pairs))
    longest = 0
    for i in range(len(trees.start) - 1):
        longest = max(longest, trees.start[i + 1] - trees.start[i])
    t, s, line = np.zeros(longest), np.zeros(longest), np.zeros(3)
    for k in range(len(pairs)):
        cross(planes.normal[pairs[k, 0]], planes.normal[pairs[k, 1]], line)
        sine = np.sqrt(dot(line, line))
        if sine > PARALLEL:
            normalise(line)
            out[k] = crossing(trees, planes, pairs[k], line, sine, spacing[k], beyond, t, s)
    return out
