"""Correlation of scans with places: how well turned and shifted points lie on what was seen there (Olson 2009)."""

from prf.kernels._jit import Array, core_entry


@core_entry
def correlate(field: Array, column: Array, row: Array, total: Array) -> None:
    """Add to `total` (n_turns, n_y, n_x) the values of a field at points shifted by whole cells.

    `field` (height, width) is 0 outside; `column`, `row` (n_turns, n) are the cells of the points at every turn before
    the first shift.
    """
    height, width = field.shape
    for turn in range(total.shape[0]):
        for point in range(column.shape[1]):
            first = column[turn, point]
            low, high = max(0, -first), min(total.shape[2], width - first)
            for y in range(max(0, -row[turn, point]), min(total.shape[1], height - row[turn, point])):
                for x in range(low, high):
                    total[turn, y, x] += field[row[turn, point] + y, first + x]
