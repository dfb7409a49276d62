"""What makes two patches cross one another, and how far from their edges (equation 12); criterion in `crossings`."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.box_trees import BoxTrees
from mapq.kernels.order_statistics import quantile
from mapq.kernels.planes import Planes, cross, dot, dot_from, normalise

LOW, HIGH = 0.02, 0.98
"""Quantiles taken for the edges of a patch: growing regions leave a few points beyond them."""
PARALLEL = 1e-6
"""Sine below which there is no line of intersection in float64; noise ends the crossing long before."""
STEP = 4.0
"""Spacings in a step of the line, within which both patches must lie on both sides; two cells at least."""
BESIDE = 3.0
"""Spacings, beyond twice the slack, up to which points lie beside the line."""
STEEP = 0.17
"""Sine, of 10 degrees, from which openings count in full: at less, what lies beside the line is too far off to show."""
DENSE = 0.15
"""Share of the points that a patch has elsewhere from which it has points beside the line."""


class CutLine(NamedTuple):
    """The line where the planes of two patches cut, and scratch for the places of points about it."""

    pair: Ints  # (2,) the patches
    line: Floats  # (3,) unit vector
    sine: float  # of the angle between the planes
    t: Floats  # places across the line, see `line_places`
    s: Floats  # places along it


@part
def line_places(trees: BoxTrees, planes: Planes, cut: CutLine, side: int) -> int:
    """Place of each point of one patch of a pair in its plane: t across the line of the cut, s along; how many.

    Across, it is the point's height over the other plane once put on its own, over the sine of their angle.
    """
    i, j = cut.pair[side], cut.pair[1 - side]
    n = trees.start[i + 1] - trees.start[i]
    ni, nj = planes.normal[i], planes.normal[j]
    cosine = dot(ni, nj)
    for k in range(n):
        point = trees.points[trees.start[i] + k]
        height = dot_from(nj, point, planes.centre[j]) - cosine * dot_from(ni, point, planes.centre[i])
        cut.t[k] = height / cut.sine
        cut.s[k] = dot_from(cut.line, point, planes.centre[i])
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
def edge_ratio(t: Floats, n: int, slack: float, reach: Floats) -> float:
    """Nearer over farther edge distance from the line, both less `slack`; 0 unless it lies between the edges.

    `reach` (2,) takes both distances, of the edges at negative and at positive t.
    """
    if n == 0:
        return 0.0
    reach[0], reach[1] = -quantile(t, n, LOW) - slack, quantile(t, n, HIGH) - slack
    near, far = min(reach[0], reach[1]), max(reach[0], reach[1])
    return near / far if near > 0.0 else 0.0


@part
def count_beside(
    t: Floats, s: Floats, n: int, low: float, high: float, slack: float, reach: Floats, counts: Ints
) -> None:
    """Count points with s from `low` to `high` by steps of the line (k) and by the side of it on which they lie (k, 2).

    Those count that are farther than `slack` from the line, by at most the `reach` (2,) of their side.
    """
    counts[:] = 0
    for k in range(n):
        side = 1 if t[k] > 0.0 else 0
        if low <= s[k] <= high and slack < abs(t[k]) <= slack + reach[side]:
            counts[min(int((s[k] - low) / (high - low) * len(counts)), len(counts) - 1), side] += 1


@part
def crossed_share(
    trees: BoxTrees, planes: Planes, cut: CutLine, low: float, high: float, slack: float, step: float, reach: Floats
) -> float:
    """Share of the stretch of the line (low, high) in whose steps both patches have points beside it, on both sides.

    A few points are none: `DENSE` of what the patch's density would make there. `reach` (2, 2) is how far beside the
    line, less the slack, each patch is looked for on either side.
    """
    n_steps = max(int((high - low) / step + 0.5), 1)
    counts, crossed = np.zeros((n_steps, 2), np.int64), np.ones(n_steps, np.bool_)
    for side in range(2):
        move = dot_from(cut.line, planes.centre[cut.pair[0]], planes.centre[cut.pair[1]]) if side == 1 else 0.0
        n = line_places(trees, planes, cut, side)
        count_beside(cut.t, cut.s, n, low + move, high + move, slack, reach[side], counts)
        for k in range(n_steps):
            for beside in range(2):
                expected = n / planes.area[cut.pair[side]] * (high - low) / n_steps * reach[side, beside]
                crossed[k] &= counts[k, beside] >= max(DENSE * expected, 1.0)
    return crossed.sum() / n_steps


@part
def crossing(trees: BoxTrees, planes: Planes, cut: CutLine, spacing: float, cell: float, beyond: float) -> float:
    """R of one pair: the smaller edge ratio of both, over the stretch of the line along which both lie.

    First each patch as a whole, which settles most pairs, then the part of it along the common stretch; the patch with
    fewer points first. Last, along which share of it they pass through one another, not through an opening.
    """
    slack = spacing + beyond / cut.sine
    shift = dot_from(cut.line, planes.centre[cut.pair[0]], planes.centre[cut.pair[1]])
    low, high, smallest = -np.inf, np.inf, 1.0
    reach = np.zeros((2, 2))
    for step in range(4):
        side = step % 2
        move = shift if side == 1 else 0.0
        n = line_places(trees, planes, cut, side)
        if step >= 2:
            n = keep_between(cut.t, cut.s, n, low + move, high + move)
        ratio = edge_ratio(cut.t, n, slack, reach[side])
        if ratio == 0.0:
            return 0.0
        if step < 2:
            low, high = max(low, quantile(cut.s, n, LOW) - move), min(high, quantile(cut.s, n, HIGH) - move)
        else:
            smallest = min(smallest, ratio)
        if high - low <= spacing:
            return 0.0
    reach = np.minimum(reach, slack + BESIDE * spacing)
    share = crossed_share(trees, planes, cut, low, high, slack, max(STEP * spacing, 2.0 * cell), reach)
    return smallest * (1.0 - min(cut.sine / STEEP, 1.0) * (1.0 - share))


@jit
def crossings(trees: BoxTrees, planes: Planes, pairs: Ints, spacing: Floats, cell: Floats, beyond: float) -> Floats:
    """R (n,) of each pair: 1 where the patches cross in their middles, 0 at an edge of either, or if they do not.

    Each must reach beyond the plane of the other by the distance `beyond`, on both sides: less than that noise, or a
    region that grows over its edge, explains. The point spacing is slack too. R is weighted by the share of the line
    along which both patches have points close to it on both sides at the same places: through an opening nothing
    crosses. That counts in full from 10 degrees on. `cell` (m,) is the side in metres of cells that leave no holes
    between the points of each patch. Curved patches have none.
    """
    out = np.zeros(len(pairs))
    longest = 0
    for i in range(len(trees.start) - 1):
        longest = max(longest, trees.start[i + 1] - trees.start[i])
    t, s, line = np.zeros(longest), np.zeros(longest), np.zeros(3)
    for k in range(len(pairs)):
        cross(planes.normal[pairs[k, 0]], planes.normal[pairs[k, 1]], line)
        sine = np.sqrt(dot(line, line))
        if sine > PARALLEL and planes.bend[pairs[k, 0]] == planes.bend[pairs[k, 1]] == 0.0:
            normalise(line)
            widest = max(cell[pairs[k, 0]], cell[pairs[k, 1]])
            cut = CutLine(pairs[k], line, sine, t, s)
            out[k] = crossing(trees, planes, cut, spacing[k], widest, beyond)
    return out
