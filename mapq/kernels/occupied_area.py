"""Occupied cells of a patch in its plane: at which size they have no holes between points, and how many there are."""

import numpy as np

from mapq.kernels._jit import Bytes, Floats, Ints, jit, part

STEP = 2.0**0.5
"""Ratio between the cell sizes that are tried."""


GROWTH = 1.05
"""Ratio of areas at two sizes below which there are no holes left to be filled."""
TIE = 1e-9
"""Share within which two areas count as equal: they are whole numbers of cells that double from size to size but for
rounding, so ties are common, and rounding is not to decide them."""


@part
def cell_of(x: float, middle: float, cell: float, half: int) -> int:
    """Column of x in a row of ``2 half + 1`` cells centred on `middle`, so that a mirrored patch has mirrored cells."""
    return int(np.floor((x - middle) / cell + 0.5)) + half


@part
def half_count(length: float, cell: float) -> int:
    """How many cells a row needs on either side of the middle one."""
    return int(np.floor(0.5 * length / cell + 0.5))


@part
def mark_closed(marks: Bytes, n_rows: int, n_columns: int, bit: int, closed_bit: int) -> None:
    """Set `closed_bit` where `bit` is set, or is on both sides in the row or the column.

    Fills the single cells that chance left empty without growing the outline.
    """
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


@part
def count_blocks(marks: Bytes, n_rows: int, n_columns: int, bits: int, wide: int) -> int:
    """How many cells (wide 0), or corners of four cells (wide 1), are such that all their cells have all `bits`.

    Corners measure area without the half cell by which occupied cells reach over an outline: w x h cells have
    (w - 1) (h - 1) of them. Single rows and scattered cells have none.
    """
    n_set = 0
    for row in range(n_rows - wide):
        for column in range(n_columns - wide):
            if block(marks, row * n_columns + column, n_columns, wide) & bits == bits:
                n_set += 1
    return n_set


@part
def block(marks: Bytes, k: int, n_columns: int, wide: int) -> int:
    """Bits that cell k and, if wide is 1, its neighbours to the right, above, and between, have in common."""
    above = k + wide * n_columns
    return marks[k] & marks[k + wide] & marks[above] & marks[above + wide]


@part
def mark_cells(u: Floats, v: Floats, box: Floats, cell: float, marks: Bytes) -> tuple[int, int]:
    """Set bit 1 of the cells that hold points, and bit 2 once closed; rows and columns. box: as `first_cell`."""
    half_u, half_v = half_count(box[1], cell), half_count(box[3], cell)
    n_columns, n_rows = 2 * half_u + 1, 2 * half_v + 1
    for k in range(n_rows * n_columns):
        marks[k] = 0
    for k in range(len(u)):
        column = min(max(cell_of(u[k], box[0], cell, half_u), 0), n_columns - 1)
        row = min(max(cell_of(v[k], box[2], cell, half_v), 0), n_rows - 1)
        marks[row * n_columns + column] = 1
    mark_closed(marks, n_rows, n_columns, 1, 2)
    return n_rows, n_columns


@part
def first_cell(box: Floats, n: int, smallest: float) -> float:
    """Smallest size worth trying: four cells a point if they filled their box (middle and length in u, in v) evenly."""
    thin = max(box[1], box[3]) / n
    area = max(box[1], thin) * max(box[3], thin)
    return max(0.5 * np.sqrt(area / n), smallest)


@part
def choose_cell(u: Floats, v: Floats, box: Floats, smallest: float, marks: Bytes, inner: Floats) -> float:
    """Smallest size at which cells leave no holes between points; the mean spacing where no cells have corners.

    The area within corners is nought while cells are finer than the sampling, rises steeply and then stays. The size is
    that from which it grows by less than `GROWTH`, once it is half of what it ever gets.
    """
    finest = first_cell(box, len(u), smallest)
    cell, most = finest, 0.0
    for k in range(len(inner)):
        n_rows, n_columns = mark_cells(u, v, box, cell, marks)
        inner[k] = cell * cell * count_blocks(marks, n_rows, n_columns, 2, 1)
        most = max(most, inner[k])
        cell *= STEP
    if most == 0.0:
        return 2.0 * finest
    cell = finest
    for k in range(len(inner) - 1):
        if inner[k] >= 0.5 * most * (1.0 - TIE) and inner[k + 1] <= GROWTH * inner[k] * (1.0 + TIE):
            break
        cell *= STEP
    return cell


@part
def find_box(u: Floats, v: Floats, box: Floats) -> None:
    """Write where points lie and how far they reach: middle and length in u, then in v."""
    for axis in range(2):
        low, high = np.inf, -np.inf
        for value in u if axis == 0 else v:
            low, high = min(low, value), max(high, value)
        box[2 * axis], box[2 * axis + 1] = 0.5 * (low + high), high - low


@part
def with_room(marks: Bytes, box: Floats, cell: float) -> Bytes:
    """Return marks for all cells of a size that cover a box."""
    needed = (2 * half_count(box[1], cell) + 1) * (2 * half_count(box[3], cell) + 1)
    return marks if needed <= len(marks) else np.zeros(2 * needed, np.uint8)


@jit
def occupied_cells(u: Floats, v: Floats, start: Ints, smallest: float, n_sizes: int) -> tuple[Floats, Floats]:
    """Cell size (m,) and extents (m, 2) of each patch, points given in its plane, in metres."""
    n_patches = len(start) - 1
    cells, lengths = np.zeros(n_patches), np.zeros((n_patches, 2))
    marks, box, inner = np.zeros(1024, np.uint8), np.zeros(4), np.zeros(n_sizes)
    for i in range(n_patches):
        cells[i] = smallest
        if start[i + 1] > start[i]:
            a, b = u[start[i] : start[i + 1]], v[start[i] : start[i + 1]]
            find_box(a, b, box)
            marks = with_room(marks, box, first_cell(box, len(a), smallest))
            cells[i] = choose_cell(a, b, box, smallest, marks, inner)
            lengths[i, 0], lengths[i, 1] = box[1], box[3]
    return cells, lengths


@jit
def occupied_areas(u: Floats, v: Floats, start: Ints, side: Floats) -> Floats:
    """Area (m,) in square metres that cells of the given sides (m,) hold of each patch, points given in its plane."""
    areas, box, marks = np.zeros(len(start) - 1), np.zeros(4), np.zeros(1024, np.uint8)
    for i in range(len(areas)):
        if start[i + 1] > start[i]:
            a, b = u[start[i] : start[i + 1]], v[start[i] : start[i + 1]]
            find_box(a, b, box)
            marks = with_room(marks, box, side[i])
            n_rows, n_columns = mark_cells(a, b, box, side[i], marks)
            n_set = count_blocks(marks, n_rows, n_columns, 2, 1)
            areas[i] = side[i] ** 2 * (n_set if n_set > 0 else count_blocks(marks, n_rows, n_columns, 2, 0))
    return areas
