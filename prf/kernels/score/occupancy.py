"""Updates of an occupancy grid: beams through cells, and cones over them (inverse sensor models)."""

import math
from typing import NamedTuple

from prf.kernels._jit import Array, core, core_entry
from prf.kernels.state.grid import Grid, cells_of_box, walk

HIT_STEP = 0
MISS_STEP = 1
LEAST = 2
MOST = 3


class Cells(NamedTuple):
    """What is known of each cell of a grid; cells are numbered as in `Grid`."""

    grid: Grid
    hits: Array  # (n_cells,) i4 readings that ended in the cell
    misses: Array  # (n_cells,) i4 readings that passed it
    log_odds: Array  # (n_cells,) f8
    steps: Array  # (4,) f8 change of log odds by a hit and by a miss, least and most log odds
    path: Array  # (most_cells,) i4 scratch for one walk


@core
def count_hit(cells: Cells, cell: int) -> None:
    """Count a reading that ended in a cell."""
    cells.hits[cell] += 1
    cells.log_odds[cell] = min(cells.log_odds[cell] + cells.steps[HIT_STEP], cells.steps[MOST])


@core
def count_miss(cells: Cells, cell: int) -> None:
    """Count a reading that passed a cell."""
    cells.misses[cell] += 1
    cells.log_odds[cell] = max(cells.log_odds[cell] + cells.steps[MISS_STEP], cells.steps[LEAST])


@core_entry
def update_beams(cells: Cells, segments: Array, returned: Array) -> None:
    """Enter beams: rows of `segments` (n, 4) run from the sensor to the end; without a return the end is free too."""
    for beam in range(segments.shape[0]):
        ends = segments[beam]
        n = walk(cells.grid, ends[0], ends[1], ends[2], ends[3], cells.path)
        for k in range(n - 1):
            count_miss(cells, cells.path[k])
        if returned[beam]:
            count_hit(cells, cells.path[n - 1])
        else:
            count_miss(cells, cells.path[n - 1])


@core
def update_cone(
    cells: Cells, x: float, y: float, ux: float, uy: float, least_cosine: float, near: float, far: float
) -> None:
    """Enter one cone: centres nearer than `near` are free, from there to `far` occupied; others stay as they are."""
    grid = cells.grid
    reach = max(near, far)
    i0, i1, k0, k1 = cells_of_box(grid, x - reach, y - reach, x + reach, y + reach)
    for k in range(k0, k1 + 1):
        dy = grid.y0 + (k + 0.5) * grid.cell - y
        for i in range(i0, i1 + 1):
            dx = grid.x0 + (i + 0.5) * grid.cell - x
            distance = math.sqrt(dx * dx + dy * dy)
            if dx * ux + dy * uy < least_cosine * distance:
                continue
            if distance < near:
                count_miss(cells, i + grid.nx * k)
            elif distance <= far:
                count_hit(cells, i + grid.nx * k)


@core_entry
def update_cones(cells: Cells, cones: Array) -> None:
    """Enter cones, rows x, y, direction (2), cosine of half the opening, `near` and `far` (see `update_cone`)."""
    for row in range(cones.shape[0]):
        cone = cones[row]
        update_cone(cells, cone[0], cone[1], cone[2], cone[3], cone[4], cone[5], cone[6])
