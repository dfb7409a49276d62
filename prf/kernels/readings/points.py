"""Point observations: values at places whose density depends on the colour of the map there (paper, equation 5).

Points are kept in bands of ascending y, sorted by x within a band. A band whose points share one y, such as a row of
a bitmap, is read by where the loop crosses it; in any other each point in the loop's box is tested. For every
point the gain of log likelihood if its colour turned is kept: a proposal's change is a sum over the points inside its
loop, and turning is a change of sign.
"""

from typing import NamedTuple

from prf.kernels._jit import Array, core
from prf.kernels.state.geometry import inside_loop, loop_box
from prf.kernels.state.image import row_crossings

# Rows of ``Points.column``.
X = 0
Y = 1
LOG_WHITE = 2  # log density of the value if the place is white
LOG_BLACK = 3  # and if it is black
BLACK = 4  # present colour, 1 black
GAIN = 5  # change of log likelihood if the colour turned
N_COLUMNS = 6

# Rows of ``Points.band``.
FIRST = 0  # first point; in the last column, which is no band, the number of points
LOWEST = 1  # y; bands do not overlap
HIGHEST = 2
N_BAND = 3


class Points(NamedTuple):
    """Points with their present colours, band by band.

    Two arrays and no more: each array of a chain costs one or two per cent of the steps, with points or without.
    """

    column: Array  # (N_COLUMNS, n) f8
    band: Array  # (N_BAND, n_bands + 1) f8


@core
def first_not_below(values: Array, start: int, end: int, limit: float) -> int:
    """First of the ascending values[start:end] that is not below `limit`, else `end`."""
    while start < end:
        middle = (start + end) // 2
        if values[middle] < limit:
            start = middle + 1
        else:
            end = middle
    return start


@core
def turn(points: Points, k: int) -> None:
    """Give point k the other colour."""
    points.column[BLACK, k] = 1.0 - points.column[BLACK, k]
    points.column[GAIN, k] = -points.column[GAIN, k]


@core
def row_gain(points: Points, band: int, loop: Array, n: int, crossings: Array, turns: bool) -> float:
    """Gain of the points of one row inside the loop, which turn if `turns`."""
    change = 0.0
    start = int(points.band[FIRST, band])
    end = int(points.band[FIRST, band + 1])
    found = row_crossings(crossings, loop, n, points.band[LOWEST, band])
    for pair in range(0, found - 1, 2):
        first = first_not_below(points.column[X], start, end, crossings[pair])
        last = first_not_below(points.column[X], first, end, crossings[pair + 1])
        for k in range(first, last):
            change += points.column[GAIN, k]
            if turns:
                turn(points, k)
    return change


@core
def scattered_gain(points: Points, band: int, loop: Array, n: int, x_min: float, x_max: float, turns: bool) -> float:
    """Gain of the points of one band inside the loop, whose box spans x_min to x_max; they turn if `turns`."""
    change = 0.0
    end = int(points.band[FIRST, band + 1])
    k = first_not_below(points.column[X], int(points.band[FIRST, band]), end, x_min)
    while k < end and points.column[X, k] <= x_max:
        if inside_loop(points.column[X, k], points.column[Y, k], loop, n):
            change += points.column[GAIN, k]
            if turns:
                turn(points, k)
        k += 1
    return change


@core
def gain_inside(points: Points, loop: Array, n: int, crossings: Array, turns: bool) -> float:
    """Change of log likelihood if all points inside the loop of `n` corners turned; they do if `turns`.

    `crossings` (2 MOST_CHANGES,) is scratch for one row.
    """
    x_min, y_min, x_max, y_max = loop_box(loop, n)
    change = 0.0
    n_bands = points.band.shape[1] - 1
    band = first_not_below(points.band[HIGHEST], 0, n_bands, y_min)
    while band < n_bands and points.band[LOWEST, band] <= y_max:
        if points.band[LOWEST, band] == points.band[HIGHEST, band]:
            change += row_gain(points, band, loop, n, crossings, turns)
        else:
            change += scattered_gain(points, band, loop, n, x_min, x_max, turns)
        band += 1
    return change


@core
def sum_points(points: Points) -> float:
    """Log likelihood of all points given their present colours."""
    total = 0.0
    for k in range(points.column.shape[1]):
        total += points.column[LOG_BLACK if points.column[BLACK, k] != 0.0 else LOG_WHITE, k]
    return total
