"""The points of each patch in its own plane, sorted into square cells, and the gap that parts each from the next."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part

LINE = 0.02
"""Ratio of second moments below which neighbours lie on a line: their spread across is a seventh of that along."""
RINGS = 3
"""Rings of cells searched for neighbours; where they hold too few, the gap ends with them."""


class Sheets(NamedTuple):
    """Points (k,) patch after patch, within a patch cell after cell; cells numbered over all patches."""

    u: Floats  # (k,) across
    v: Floats  # (k,) along, metres from the patch's centre
    gap: Floats  # (k,) metres, see `gap_at`
    cell: Floats  # (m,) side of the cells
    low: Floats  # (m, 2) corner of the first cell
    size: Ints  # (m, 2) columns and rows
    base: Ints  # (m + 1,) number of the patch's first cell
    first: Ints  # (cells + 1,) number of each cell's first point
    number: Ints  # (k,) number of the point among those of all patches


@part
def first_corner(lowest: float, highest: float, cell: float) -> float:
    """Where the fewest cells begin that hold an extent, as much over at either end: the same as seen from behind."""
    return 0.5 * (lowest + highest - (int((highest - lowest) / cell) + 1) * cell)


@jit
def count_sheet_cells(u: Floats, v: Floats, start: Ints, cell: Floats, low: Floats, size: Ints, base: Ints) -> None:
    """Fill the corner, the size and the first cell's number of each patch."""
    base[0] = 0
    for i in range(len(start) - 1):
        low[i, 0] = low[i, 1] = 0.0
        size[i, 0] = size[i, 1] = 0
        if start[i + 1] > start[i]:
            a, b = u[start[i] : start[i + 1]], v[start[i] : start[i + 1]]
            low[i, 0], low[i, 1] = first_corner(a.min(), a.max(), cell[i]), first_corner(b.min(), b.max(), cell[i])
            size[i, 0] = int((a.max() - low[i, 0]) / cell[i]) + 1
            size[i, 1] = int((b.max() - low[i, 1]) / cell[i]) + 1
        base[i + 1] = base[i] + size[i, 0] * size[i, 1]


@part
def cell_number(sheets: Sheets, i: int, u: float, v: float) -> int:
    """Cell of patch i that holds a point of it."""
    column = min(int((u - sheets.low[i, 0]) / sheets.cell[i]), sheets.size[i, 0] - 1)
    row = min(int((v - sheets.low[i, 1]) / sheets.cell[i]), sheets.size[i, 1] - 1)
    return sheets.base[i] + row * sheets.size[i, 0] + column


@jit
def fill_sheets(sheets: Sheets, u: Floats, v: Floats, start: Ints) -> None:
    """Sort the points of every patch into its cells (counting sort) and find their gaps."""
    first = sheets.first
    first[:] = 0
    for i in range(len(start) - 1):
        for k in range(start[i], start[i + 1]):
            first[cell_number(sheets, i, u[k], v[k]) + 1] += 1
    for cell in range(len(first) - 1):
        first[cell + 1] += first[cell]
    place = first[:-1].copy()
    for i in range(len(start) - 1):
        for k in range(start[i], start[i + 1]):
            cell = cell_number(sheets, i, u[k], v[k])
            at = place[cell]
            sheets.u[at], sheets.v[at], sheets.number[at] = u[k], v[k], k
            place[cell] = at + 1
    near, sides = np.zeros((4, 3)), np.zeros(4)
    for i in range(len(start) - 1):
        for k in range(start[i], start[i + 1]):
            sheets.gap[k] = gap_at(sheets, i, k, near, sides)


@part
def side_of(right: float, above: float) -> int:
    """Side on which a point lies: 0 right, 1 left, 2 above, 3 below, parted by the diagonals."""
    if abs(right) >= abs(above):
        return 0 if right >= 0.0 else 1
    return 2 if above > 0.0 else 3


@part
def gap_at(sheets: Sheets, i: int, k: int, near: Floats, sides: Floats) -> float:
    """Gap at point k of patch i: the distance to its neighbour of rank 4, about the side of the square it has.

    Where these four lie on a line, a scan line, dense along and far from the next, it is the distance within which
    there are points on three of its sides; three, as a point at an edge has none on the fourth.
    """
    u, v, cell = sheets.u[k], sheets.v[k], sheets.cell[i]
    column = min(int((u - sheets.low[i, 0]) / cell), sheets.size[i, 0] - 1)
    row = min(int((v - sheets.low[i, 1]) / cell), sheets.size[i, 1] - 1)
    for ring in range(1, RINGS + 1):
        limit = (ring * cell) ** 2
        for kept in range(len(near)):
            near[kept, 0], near[kept, 1], near[kept, 2] = limit, 0.0, 0.0
        sides[:] = limit
        for y in range(max(row - ring, 0), min(row + ring + 1, sheets.size[i, 1])):
            from_cell = sheets.base[i] + y * sheets.size[i, 0] + max(column - ring, 0)
            to_cell = sheets.base[i] + y * sheets.size[i, 0] + min(column + ring, sheets.size[i, 0] - 1)
            for other in range(sheets.first[from_cell], sheets.first[to_cell + 1]):
                right, above = sheets.u[other] - u, sheets.v[other] - v
                square = right * right + above * above
                if 0.0 < square < limit:
                    side = side_of(right, above)
                    sides[side] = min(sides[side], square)
                    keep_nearest(near, square, right, above)
        gap = second_largest(sides) if on_a_line(near) else near[-1, 0]
        if gap < limit:
            break
    return np.sqrt(gap)


@part
def keep_nearest(near: Floats, square: float, right: float, above: float) -> None:
    """Enter a point into the nearest ones kept: squared distance and place, sorted."""
    if square >= near[-1, 0]:
        return
    place = len(near) - 1
    while place > 0 and near[place - 1, 0] > square:
        for column in range(3):
            near[place, column] = near[place - 1, column]
        place -= 1
    near[place, 0], near[place, 1], near[place, 2] = square, right, above


@part
def on_a_line(near: Floats) -> bool:
    """Whether the points kept lie on a line through the point: their second moments across and along differ much."""
    uu, vv, uv = 0.0, 0.0, 0.0
    for row in range(len(near)):
        uu += near[row, 1] * near[row, 1]
        vv += near[row, 2] * near[row, 2]
        uv += near[row, 1] * near[row, 2]
    half = 0.5 * (uu + vv)
    root = np.sqrt(max(half * half - (uu * vv - uv * uv), 0.0))
    return half - root < LINE * (half + root)


@part
def second_largest(four: Floats) -> float:
    """The second largest of four numbers."""
    largest, second = -np.inf, -np.inf
    for value in four:
        if value > largest:
            largest, second = value, largest
        elif value > second:
            second = value
    return second
