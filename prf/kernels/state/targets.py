"""Where returns lie: the squares at which births are aimed, each with its probability.

The squares never depend on the present map, so that a birth and the death that takes it back see the same ones, and
their densities are known whatever the map.
"""

from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import Grid, cell_at

NEAR = 12
"""Squares are near one another if their middles lie at most so many sides apart."""


class Targets(NamedTuple):
    """Squares of a fine grid that hold a return, and for each the squares near it."""

    grid: Grid
    cell: Array  # (n,) i4 cells of the grid that are targets
    cumulative: Array  # (n,) f8 probability of being picked, summed; the last is 1
    number: Array  # (n_cells,) i4 number of the target of a cell, NONE where there is none
    near_start: Array  # (n + 1,) i8
    near: Array  # (pairs,) i4 targets near each, itself among them


@core
def target_of(targets: Targets, graph: Graph, vertex: int) -> int:
    """Number of the target that holds a vertex, or NONE."""
    return targets.number[cell_at(targets.grid, graph.vertex_xy[vertex, 0], graph.vertex_xy[vertex, 1])]


@core
def point_in(targets: Targets, number: int, rng: Rng) -> tuple[float, float]:
    """Uniform point of a target."""
    cell = targets.cell[number]
    grid = targets.grid
    x = grid.x0 + (cell % grid.nx + rng.random()) * grid.cell
    y = grid.y0 + (cell // grid.nx + rng.random()) * grid.cell
    return x, y


@core
def pick_target(targets: Targets, tuning: Array, rng: Rng) -> int:
    """Target with its probability; in a region a uniform one near the middle."""
    if tuning[c.REGION_TARGET] != c.NONE:
        return pick_near(targets, int(tuning[c.REGION_TARGET]), rng)
    u = rng.random()
    low = 0
    high = targets.cell.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if u < targets.cumulative[middle]:
            high = middle
        else:
            low = middle + 1
    return low


@core
def pick_near(targets: Targets, number: int, rng: Rng) -> int:
    """Uniform target among those near one."""
    start = targets.near_start[number]
    n = targets.near_start[number + 1] - start
    return targets.near[start + min(int(rng.random() * n), n - 1)]


@core
def first_density(targets: Targets, tuning: Array, number: int) -> float:
    """Density in the plane of a point in a target that was picked; 0 where there is none."""
    if number == c.NONE:
        return 0.0
    if tuning[c.REGION_TARGET] != c.NONE:
        return second_density(targets, int(tuning[c.REGION_TARGET]), number)
    share = targets.cumulative[number]
    if number > 0:
        share -= targets.cumulative[number - 1]
    return share / (targets.grid.cell * targets.grid.cell)


@core
def second_density(targets: Targets, number: int, other: int) -> float:
    """Density of a point in the target `other` among those near the target `number`; 0 where it is not near."""
    if number == c.NONE or other == c.NONE:
        return 0.0
    nx = targets.grid.nx
    dx = targets.cell[number] % nx - targets.cell[other] % nx
    dy = targets.cell[number] // nx - targets.cell[other] // nx
    if dx * dx + dy * dy > NEAR * NEAR:
        return 0.0
    n = targets.near_start[number + 1] - targets.near_start[number]
    return 1.0 / (n * targets.grid.cell * targets.grid.cell)
