"""Occupied cells of a patch in its plane: at which size they have no holes between points, and how many there are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

STEP = 2.0**0.5
"""Ratio between the cell sizes that are tried."""


@part
def cell_of(x: float, middle: float, cell: float, half: int) -> int:
    """Column of x in a row of ``2 half + 1`` cells centred on `middle`, so that a mirrored patch has mirrored cells."""
    return int(np.floor((x - middle) / cell + 0.5)) + half


@part
def half_count(length: float, cell: float) -> int:
    """How many cells a row needs on either side of the middle one."""
    return int(np.floor(0.5 * length / cell + 0.5))


@part
def mark_closed(marks: Bytes, n_rows: int, n_columns: int, bit: int, closed_bit: int) -> int:
    """Set `closed_bit` where `bit` is set, or is on both sides in the row or the column; return how many are set.

    Fills the single cells that chance left empty without growing the outline.
    """
    n_set = 0
    for row in range(n_rows):
        for column in range(n_columns):
            k = row * n_columns + column
            there = marks[k] & bit != 0
            if not there and 0 < column < n_columns - 1:
                there = marks[k - 1] & bit != 0 and marks[k + 1] & bit != 0
            if not there and 0 < row < n_rows - 1:
                there = marks[k - n_columns] & bit != 0 and marks[k + n_columns] & bit != 0
            if there:
                marks[k] |= closed_bit
                n_set += 1
    return n_set


@part
def count_cells(u: Floats, v: Floats, box: Floats, cell: float, marks: Bytes, closed: bool) -> int:
    """How many cells of side `cell` hold points; box: middle and length in u, then in v."""
    half_u, half_v = half_count(box[1], cell), half_count(box[3], cell)
    n_columns, n_rows = 2 * half_u + 1, 2 * half_v + 1
    n_set = 0
    for k in range(n_rows * n_columns):
        marks[k] = 0
    for k in range(len(u)):
        column = min(max(cell_of(u[k], box[0], cell, half_u), 0), n_columns - 1)
        row = min(max(cell_of(v[k], box[2], cell, half_v), 0), n_rows - 1)
        if marks[row * n_columns + column] == 0:
            marks[row * n_columns + column] = 1
            n_set += 1
    if closed:
        return mark_closed(marks, n_rows, n_columns, 1, 2)
    return n_set


@part
def first_cell(box: Floats, n: int, smallest: float) -> float:
    """Smallest size worth trying: four cells a point if the points filled their box evenly."""
    thin = max(box[1], box[3]) / n
    area = max(box[1], thin) * max(box[3], thin)
    return max(0.5 * np.sqrt(area / n), smallest)


@part
def choose_cell(u: Floats, v: Floats, box: Floats, smallest: float, n_sizes: int, marks: Bytes) -> float:
    """Smallest size at which the occupied area grows slower than the root of the size, else the one of least growth.

    While cells are finer than the sampling, the area grows with the square of their size (single points) or in
    proportion (scan lines); once they are hole-free, only along the outline.
    """
    cell = first_cell(box, len(u), smallest)
    count = count_cells(u, v, box, cell, marks, False)
    best, least = cell, np.inf
    for _ in range(n_sizes):
        wider = count_cells(u, v, box, cell * STEP, marks, False)
        growth = 2.0 + np.log(wider / count) / np.log(STEP)
        if growth < least - 1e-9:
            best, least = cell, growth
        if growth <= 0.5:
            break
        cell, count = cell * STEP, wider
    return best


@part
def middle_and_length(values: Floats, box: Floats, first: int) -> None:
    """Write where values lie to ``box[first]``, and how far they reach to the next."""
    low, high = np.inf, -np.inf
    for k in range(len(values)):
        low, high = min(low, values[k]), max(high, values[k])
    box[first], box[first + 1] = 0.5 * (low + high), high - low


@jit
def occupied_cells(u: Floats, v: Floats, start: Ints, smallest: float, n_sizes: int) -> tuple[Floats, Floats, Floats]:
    """Cell size (m,), occupied area (m,) and extents (m, 2) of each patch, points given in its plane, in metres."""
    n_patches = len(start) - 1
    cells, areas, lengths = np.zeros(n_patches), np.zeros(n_patches), np.zeros((n_patches, 2))
    marks = np.zeros(1024, np.uint8)
    box = np.zeros(4)
    for i in range(n_patches):
        cells[i] = smallest
        if start[i + 1] == start[i]:
            continue
        a, b = u[start[i] : start[i + 1]], v[start[i] : start[i + 1]]
        middle_and_length(a, box, 0)
        middle_and_length(b, box, 2)
        finest = first_cell(box, len(a), smallest)
        needed = (2 * half_count(box[1], finest) + 1) * (2 * half_count(box[3], finest) + 1)
        if needed > len(marks):
            marks = np.zeros(2 * needed, np.uint8)
        cells[i] = choose_cell(a, b, box, smallest, n_sizes, marks)
        areas[i] = cells[i] ** 2 * count_cells(a, b, box, cells[i], marks, True)
        lengths[i, 0], lengths[i, 1] = box[1], box[3]
    return cells, areas, lengths
