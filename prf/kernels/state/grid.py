"""Square cells over the window, and the walk of a segment through them (DDA, Amanatides & Woo 1987)."""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import Array, core

CORNER_TOLERANCE = 1e-9
"""Two border crossings closer than this share of the segment pass a cell corner: both side cells are visited.

Without it rounding could send a beam and an edge that cross near a corner through different cells, unseen.
"""

ORIGIN_SHIFT = 0.6180339887498949
"""Share of a cell by which :func:`make_grid` shifts the origin: a sensor or a beam that lies exactly on round
coordinates then never lies exactly on a border of cells."""


REL_TOL = 1e-6
ABS_TOL = 1e-9
"""Share, and metres besides, by which distances to borders of cells are lowered: rounding may then search a cell in
vain, but never miss one."""


class Grid(NamedTuple):
    """Cells ``ix + nx * iy`` with corner (`x0`, `y0`) and side `cell` (metres)."""

    x0: float
    y0: float
    cell: float
    nx: int
    ny: int


def make_grid(x_min: float, y_min: float, x_max: float, y_max: float, cell: float) -> Grid:
    """Return a grid of cells of side `cell` that covers the rectangle, its origin off round coordinates."""
    shift = ORIGIN_SHIFT * cell
    nx = math.ceil((x_max - x_min + shift) / cell) + 1
    ny = math.ceil((y_max - y_min + shift) / cell) + 1
    return Grid(float(x_min - shift), float(y_min - shift), float(cell), nx, ny)


def cells_of(grid: Grid, xy: Array) -> Array:
    """Return the cell (n,) of each point (n, 2)."""
    offset = ((xy - (grid.x0, grid.y0)) / grid.cell).astype(np.int64)
    ix, iy = np.clip(offset, 0, (grid.nx - 1, grid.ny - 1)).T
    return np.asarray(ix + grid.nx * iy)


@core
def axis_index(offset: float, n: int) -> int:
    """Index of a cell along one axis, kept inside the grid."""
    return min(max(int(offset), 0), n - 1)


@core
def cell_at(grid: Grid, x: float, y: float) -> int:
    """Cell that holds the point (x, y)."""
    ix = axis_index((x - grid.x0) / grid.cell, grid.nx)
    return ix + grid.nx * axis_index((y - grid.y0) / grid.cell, grid.ny)


@core
def cells_of_box(grid: Grid, x_min: float, y_min: float, x_max: float, y_max: float) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the cells that a box meets."""
    i0 = axis_index((x_min - grid.x0) / grid.cell, grid.nx)
    i1 = axis_index((x_max - grid.x0) / grid.cell, grid.nx)
    k0 = axis_index((y_min - grid.y0) / grid.cell, grid.ny)
    return i0, i1, k0, axis_index((y_max - grid.y0) / grid.cell, grid.ny)


@core
def axis_walk(start: float, end: float, i0: int, i1: int) -> tuple[int, float, float]:
    """Step, first border crossing and spacing of crossings along one axis, as shares of the segment."""
    if i1 > i0:
        return 1, (i0 + 1 - start) / (end - start), 1.0 / (end - start)
    if i1 < i0:
        return -1, (start - i0) / (start - end), 1.0 / (start - end)
    return 0, math.inf, math.inf


@core
def walk(grid: Grid, ax: float, ay: float, bx: float, by: float, cells: Array) -> int:
    """Write the cells that the segment ab passes into `cells`, in order, and return their number."""
    u = (ax - grid.x0) / grid.cell
    v = (ay - grid.y0) / grid.cell
    s = (bx - grid.x0) / grid.cell
    t = (by - grid.y0) / grid.cell
    ix = axis_index(u, grid.nx)
    iy = axis_index(v, grid.ny)
    jx = axis_index(s, grid.nx)
    jy = axis_index(t, grid.ny)
    step_x, next_x, space_x = axis_walk(u, s, ix, jx)
    step_y, next_y, space_y = axis_walk(v, t, iy, jy)
    n = 0
    while True:
        cells[n] = ix + grid.nx * iy
        n += 1
        if ix == jx and iy == jy:
            return n
        if ix != jx and iy != jy and abs(next_x - next_y) < CORNER_TOLERANCE:
            cells[n] = ix + step_x + grid.nx * iy
            cells[n + 1] = ix + grid.nx * (iy + step_y)
            n += 2
            ix += step_x
            iy += step_y
            next_x += space_x
            next_y += space_y
        elif iy == jy or (ix != jx and next_x < next_y):
            ix += step_x
            next_x += space_x
        else:
            iy += step_y
            next_y += space_y


def most_cells(grid: Grid) -> int:
    """Upper bound on the number of cells that one walk can write."""
    return 2 * (grid.nx + grid.ny) + 8


@core
def exit_along_axis(origin: float, direction: float, border0: float, index: int, cell: float) -> float:
    """Distance along a ray to the border by which it leaves the slab `index` of cells, inf if it never does."""
    if direction > 0.0:
        return (border0 + (index + 1) * cell - origin) / direction
    if direction < 0.0:
        return (border0 + index * cell - origin) / direction
    return math.inf


@core
def exit_distance(grid: Grid, index: int, ox: float, oy: float, ux: float, uy: float) -> float:
    """Distance along the ray o + t u at which it leaves the cell `index`."""
    along_x = exit_along_axis(ox, ux, grid.x0, index % grid.nx, grid.cell)
    along_y = exit_along_axis(oy, uy, grid.y0, index // grid.nx, grid.cell)
    return min(along_x, along_y)
