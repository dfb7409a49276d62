"""Sites whose colour matters: sensors, which must be in white, or cost something where they are not.

A grid finds those that a loop may enclose.
"""

from typing import NamedTuple

from prf.kernels._jit import Array, core
from prf.kernels.state.geometry import inside_loop, loop_box
from prf.kernels.state.grid import Grid, cells_of_box


class Sites(NamedTuple):
    """Distinct sensor positions, sorted by cell."""

    grid: Grid
    xy: Array  # (n, 2) f8
    cell_start: Array  # (n_cells + 1,) i8
    black: Array  # (n,) u1 whether a site is occupied now


@core
def cells_round(grid: Grid, loop: Array, n: int) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the cells that the first n rows of `loop` span."""
    x_min, y_min, x_max, y_max = loop_box(loop, n)
    return cells_of_box(grid, x_min, y_min, x_max, y_max)


@core
def any_inside(sites: Sites, loop: Array, n: int) -> bool:
    """Whether a site would be recoloured by the loop of `n` corners."""
    nx = sites.grid.nx
    i0, i1, k0, k1 = cells_round(sites.grid, loop, n)
    for k in range(k0, k1 + 1):
        # Cells of one row follow each other, and so do their sites.
        for site in range(sites.cell_start[i0 + nx * k], sites.cell_start[i1 + nx * k + 1]):
            if inside_loop(sites.xy[site, 0], sites.xy[site, 1], loop, n):
                return True
    return False


@core
def occupied_change(sites: Sites, loop: Array, n: int, turns: bool) -> int:
    """Change of the number of occupied sites if all inside the loop of `n` corners turned; they do if `turns`."""
    nx = sites.grid.nx
    i0, i1, k0, k1 = cells_round(sites.grid, loop, n)
    change = 0
    for k in range(k0, k1 + 1):
        for site in range(sites.cell_start[i0 + nx * k], sites.cell_start[i1 + nx * k + 1]):
            if inside_loop(sites.xy[site, 0], sites.xy[site, 1], loop, n):
                change += -1 if sites.black[site] != 0 else 1
                if turns:
                    sites.black[site] = 1 - sites.black[site]
    return change
