"""How much of two patches lies on top of one another, point by point, and at which offset."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.order_statistics import quantile
from mapq.kernels.planes import Planes, chart, dot, dot_from, facing
from mapq.kernels.sheets import Sheets, side_of

REACH = 2.0
"""A point is covered if within so many gaps of the other patch there are points of it on all four sides."""
SAME = 1e-6
"""A point within this share of the reach is at the place itself and on no side of it: rounding would choose one."""
SHARPNESS = 8.0
"""How steeply an offset begins to count at the tolerance: at 0.75 of it a tenth, at 1.33 nine tenths."""
RUN = 32
"""Points of a patch, in the order of its cells, that are passed over together where they lie off another patch."""


class Runs(NamedTuple):
    """Runs of `RUN` points of patches, patch after patch, and boxes over them."""

    first: Ints  # (m + 1,) number of each patch's first run
    middle: Floats  # (r, 3) of the box, metres
    half: Floats  # (r, 3) half of its sides


@part
def find_runs(sheets: Sheets, points: Floats, start: Ints) -> Runs:
    """Return the runs of all patches."""
    first = np.zeros(len(start), np.int64)
    for i in range(len(start) - 1):
        first[i + 1] = first[i] + (start[i + 1] - start[i] + RUN - 1) // RUN
    runs = Runs(first, np.zeros((first[-1], 3)), np.zeros((first[-1], 3)))
    for i in range(len(start) - 1):
        for run in range(first[i], first[i + 1]):
            begin = start[i] + (run - first[i]) * RUN
            for axis in range(3):
                low, high = np.inf, -np.inf
                for k in range(begin, min(begin + RUN, start[i + 1])):
                    low = min(low, points[sheets.number[k], axis])
                    high = max(high, points[sheets.number[k], axis])
                runs.middle[run, axis], runs.half[run, axis] = 0.5 * (low + high), 0.5 * (high - low)
    return runs


@part
def is_off(sheets: Sheets, planes: Planes, runs: Runs, run: int, j: int) -> bool:
    """Whether a run of points lies too far aside of patch j, which is a plane, for it to cover any: by two cells."""
    for axis in range(2):
        direction = planes.across[j] if axis == 0 else planes.along[j]
        place = dot_from(direction, runs.middle[run], planes.centre[j]) - sheets.low[j, axis]
        reach = 2.0 * sheets.cell[j]
        for each in range(3):
            reach += abs(direction[each]) * runs.half[run, each]
        if place < -reach or place > sheets.size[j, axis] * sheets.cell[j] + reach:
            return True
    return False


@part
def row_of_points(sheets: Sheets, j: int, row: int, low: int, high: int) -> tuple[int, int]:
    """Return where the points in columns `low` to `high` - 1 of a row of cells of patch j begin and end."""
    columns = sheets.size[j, 0]
    at = sheets.base[j] + row * columns
    low, high = max(low, 0), min(high, columns)
    return sheets.first[at + low], sheets.first[at + high] if high > low else sheets.first[at + low]


@part
def is_covered(sheets: Sheets, j: int, u: float, v: float) -> bool:
    """Whether points of patch j surround the place (u, v) of its plane: some near by on each of the four sides.

    Near is measured by the gap of patch j at the point closest to the place, which must lie within a cell: within a
    circle, and not in the cells beside, so that nothing depends on where the cells begin. The edge of a window is no
    cover for what shows through it: there points lie on one side only.
    """
    cell, low, size = sheets.cell[j], sheets.low[j], sheets.size[j]
    column, row = int(np.floor((u - low[0]) / cell)), int(np.floor((v - low[1]) / cell))
    if column < -1 or row < -1 or column > size[0] or row > size[1]:
        return False
    closest, gap = cell * cell, 0.0
    for y in range(max(row - 1, 0), min(row + 2, size[1])):
        begin, end = row_of_points(sheets, j, y, column - 1, column + 2)
        for k in range(begin, end):
            square = (sheets.u[k] - u) ** 2 + (sheets.v[k] - v) ** 2
            if square < closest:
                closest, gap = square, sheets.gap[k]
    reach = REACH * gap
    limit, own = reach * reach, (SAME * reach) ** 2
    if closest >= limit:
        return False
    rings = int(np.ceil(reach / cell))
    found = 0
    for y in range(max(row - rings, 0), min(row + rings + 1, size[1])):
        begin, end = row_of_points(sheets, j, y, column - rings, column + rings + 1)
        for k in range(begin, end):
            right, above = sheets.u[k] - u, sheets.v[k] - v
            if own < right * right + above * above < limit:
                found |= 1 << side_of(right, above)
        if found == 15:
            return True
    return found == 15


@part
def alike(planes: Planes, i: int, j: int, point: Floats) -> float:
    """How alike two patches face at a point: cos(2 angle)."""
    cosine = dot(facing(planes, i, point), facing(planes, j, point))
    return 2.0 * cosine * cosine - 1.0


@part
def areas_by_gap(sheets: Sheets, planes: Planes, start: Ints) -> Floats:
    """Return the area (m,) in m² that a point of each patch represents, for each square metre of its squared gap."""
    out = np.zeros(len(start) - 1)
    for i in range(len(out)):
        total = 0.0
        for k in range(start[i], start[i + 1]):
            total += sheets.gap[k] * sheets.gap[k]
        out[i] = planes.area[i] / total if total > 0.0 else 0.0
    return out


@part
def lay_over(
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    runs: Runs,
    per_square: float,
    i: int,
    j: int,
    offsets: Floats,
    areas: Floats,
) -> int:
    """Find the points of patch i that patch j covers: their offsets from plane j and the area that each represents.

    Where either is curved it is the area of their shadow on patch j, less the more they are turned to it: see `alike`.
    """
    is_curved = planes.bend[i] > 0.0 or planes.bend[j] > 0.0
    n = 0
    for run in range(runs.first[i], runs.first[i + 1]):
        if planes.bend[j] == 0.0 and is_off(sheets, planes, runs, run, j):
            continue
        begin = start[i] + (run - runs.first[i]) * RUN
        for k in range(begin, min(begin + RUN, start[i + 1])):
            point = points[sheets.number[k]]
            u, v, height = chart(planes, j, point)
            if is_covered(sheets, j, u, v):
                shadow = 1.0
                if is_curved:
                    shadow = alike(planes, i, j, point) * min(1.0 / (1.0 + planes.bend[j] * height), 1.0)
                if shadow > 0.0:
                    offsets[n] = abs(height)
                    areas[n] = per_square * sheets.gap[k] * sheets.gap[k] * shadow
                    n += 1
    return n


@part
def doubled_area(offsets: Floats, areas: Floats, n: int, reach: float, tau: float, tolerance: float) -> float:
    """How much of n covered points' area counts as a double surface.

    Not what lies within the tolerance (half counts there), and less, exp(-x / tau), where the patch is by x farther
    away than where it is closest: there another weight would be due than that of the pair.
    """
    closest = np.inf
    for k in range(n):
        closest = min(closest, offsets[k])
    total = 0.0
    for k in range(n):
        if offsets[k] <= reach and offsets[k] > 0.0:
            counts = 1.0 / (1.0 + (tolerance / offsets[k]) ** SHARPNESS)
            total += areas[k] * counts * np.exp((closest - offsets[k]) / tau)
    return total


@jit
def overlaps(
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    pairs: Ints,
    middle: Floats,
    reach: float,
    tau: float,
    tolerance: float,
) -> Floats:
    """Overlap A, covered area and offset (n, 3) of each pair of patches.

    A (equation 11): the larger of the areas of either that the other covers, over the smaller of their areas; nought
    from 45 degrees on, falling with cos(2 angle) up to there, of curved patches point by point. The offset is the
    median over the covered points of the one with more covered area; without any, the distance of the closest points'
    `middle` (n, 3) to the farther plane.
    """
    out = np.zeros((len(pairs), 3))
    longest = 0
    for i in range(len(start) - 1):
        longest = max(longest, start[i + 1] - start[i])
    offsets, areas = np.zeros(longest), np.zeros(longest)
    runs, per_square = find_runs(sheets, points, start), areas_by_gap(sheets, planes, start)
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        for side in range(2):
            out[p, 2] = max(out[p, 2], abs(chart(planes, pairs[p, side], middle[p])[2]))
        is_curved = planes.bend[i] > 0.0 or planes.bend[j] > 0.0
        turned = 1.0 if is_curved else alike(planes, i, j, middle[p])
        if turned <= 0.0:
            continue
        smaller = min(planes.area[i], planes.area[j])
        for side in range(2):
            one, other = pairs[p, side], pairs[p, 1 - side]
            n = lay_over(sheets, planes, points, start, runs, per_square[one], one, other, offsets, areas)
            if n == 0:
                continue
            counted = doubled_area(offsets, areas, n, reach, tau, tolerance)
            covered = 0.0
            for k in range(n):
                covered += areas[k]
            out[p, 0] = max(out[p, 0], min(1.0, turned * counted / smaller))
            if covered > out[p, 1]:
                out[p, 1] = covered
                out[p, 2] = quantile(offsets, n, 0.5)
    return out
