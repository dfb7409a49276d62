"""The walls of a map side by side while a chain runs, and the change of their log density by a proposal.

The table follows from the graph and is filled anew at the start of every run, row i being the wall of the i-th member
of the set of walls. A proposal names rows that go and walls that come, two of each at most.

A move that changes a wall picks one near a return `SEEN` times as often as another, so that most steps change walls
that beams end on. The weight follows from where the wall lies, and the way back picks by the weights after the move.
"""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.graph import Graph, set_remove
from prf.kernels.state.grid import Grid, axis_index, cell_at
from prf.kernels.state.proposal import Proposal, clear
from prf.kernels.state.targets import Targets
from prf.kernels.walls.law import NEAR, are_near, holds, log_alone, pair_cost
from prf.kernels.walls.shape import Wall, add_wall, length_of, remove_wall, wall_of

SEEN = 8
"""Weight of a wall near a return; that of others is 1."""

# Columns of ``Walls.row`` after the five numbers of a wall.
WEIGHT = 5  # how often it is picked, beside others
ON_FIRST = 6  # how many other walls hold its first end
ON_SECOND = 7
N_ROW = 8

# Entries of ``Walls.counts``.
N_OLD = 0
N_NEW = 1
TOTAL_WEIGHT = 2  # of all rows
N_NEARBY = 3  # entries of `nearby`
N_WALL_COUNTS = 4
MOST_WALLS = 2
"""No proposal removes or adds more walls than this."""


class Walls(NamedTuple):
    """Rows of the walls of a map, and of those that a proposal adds; and where returns are near."""

    row: Array  # (capacity, N_ROW) f8
    box: Array  # (4, capacity) f8 of each row: lowest and highest x, lowest and highest y that it reaches to
    nearby: Array  # (capacity,) i8 rows of walls near those that a proposal removes or adds
    new: Array  # (MOST_WALLS, N_ROW) f8
    old: Array  # (MOST_WALLS,) i8 rows that go
    counts: Array  # (N_WALL_COUNTS,) i8
    grid: Grid  # of `has_return`
    has_return: Array  # (n_cells,) u1 whether a return lies in a cell or in one beside it


@core
def wall_in(rows: Array, i: int) -> Wall:
    """The wall of a row."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3], rows[i, 4]


@core
def write(rows: Array, i: int, wall: Wall) -> None:
    """Write a wall into a row, as if no other held its ends."""
    rows[i, 0] = wall[0]
    rows[i, 1] = wall[1]
    rows[i, 2] = wall[2]
    rows[i, 3] = wall[3]
    rows[i, 4] = wall[4]
    rows[i, ON_FIRST] = 0.0
    rows[i, ON_SECOND] = 0.0


@core
def copy_row(rows: Array, i: int, to: Array, k: int) -> None:
    """Copy a row."""
    for column in range(N_ROW):
        to[k, column] = rows[i, column]


@core
def hold_ends(rows: Array, i: int, wall: Wall, change: float) -> None:
    """Count a wall that comes (`change` 1) or goes (-1) among those that hold the ends of a row's."""
    if holds(wall, rows[i, 0], rows[i, 1]):
        rows[i, ON_FIRST] += change
    if holds(wall, rows[i, 2], rows[i, 3]):
        rows[i, ON_SECOND] += change


@core
def box_of(wall: Wall, reach: float) -> tuple[float, float, float, float]:
    """Lowest and highest x, lowest and highest y of a wall's ends, `reach` beyond half its thickness."""
    reach += 0.5 * wall[4]
    x0, x1 = min(wall[0], wall[2]) - reach, max(wall[0], wall[2]) + reach
    return x0, x1, min(wall[1], wall[3]) - reach, max(wall[1], wall[3]) + reach


@core
def enter_box(walls: Walls, i: int) -> None:
    """Write the box of a row."""
    walls.box[0, i], walls.box[1, i], walls.box[2, i], walls.box[3, i] = box_of(wall_in(walls.row, i), NEAR)


@core
def meets(walls: Walls, i: int, x0: float, x1: float, y0: float, y1: float) -> bool:
    """Whether the box of a row meets another one; without branches, as it is asked of every row."""
    box = walls.box
    return (box[0, i] <= x1) & (box[1, i] >= x0) & (box[2, i] <= y1) & (box[3, i] >= y0)


@core
def is_on_line(walls: Walls, i: int, x: float, y: float, ux: float, uy: float) -> bool:
    """Whether the line through (x, y) along the unit vector u meets the box of a row."""
    box = walls.box
    across = ux * (0.5 * (box[2, i] + box[3, i]) - y) - uy * (0.5 * (box[0, i] + box[1, i]) - x)
    return abs(across) <= 0.5 * ((box[1, i] - box[0, i]) * abs(uy) + (box[3, i] - box[2, i]) * abs(ux))


@core
def list_nearby(graph: Graph, walls: Walls) -> None:
    """List the rows of walls near those that the proposal removes or adds: no other has to do with these."""
    x0, x1, y0, y1, n = math.inf, -math.inf, math.inf, -math.inf, 0
    for k in range(walls.counts[N_OLD] + walls.counts[N_NEW]):
        is_old = k < walls.counts[N_OLD]
        wall = wall_in(walls.row, walls.old[k]) if is_old else wall_in(walls.new, k - walls.counts[N_OLD])
        low_x, high_x, low_y, high_y = box_of(wall, 0.0)
        x0, x1, y0, y1 = min(x0, low_x), max(x1, high_x), min(y0, low_y), max(y1, high_y)
    for i in range(graph.counts[c.WALLS]):
        walls.nearby[n] = i
        n += int(meets(walls, i, x0, x1, y0, y1))
    walls.counts[N_NEARBY] = n


@core
def note_returns(targets: Targets, walls: Walls) -> None:
    """Mark the cells near a return; all of them where there is none."""
    grid, fine, n = walls.grid, targets.grid, targets.cell.shape[0]
    walls.has_return[:] = 1 if n == 0 else 0
    for number in range(n):
        x = fine.x0 + (targets.cell[number] % fine.nx + 0.5) * fine.cell
        y = fine.y0 + (targets.cell[number] // fine.nx + 0.5) * fine.cell
        i, k = axis_index((x - grid.x0) / grid.cell, grid.nx), axis_index((y - grid.y0) / grid.cell, grid.ny)
        for row in range(max(k - 1, 0), min(k + 2, grid.ny)):
            for column in range(max(i - 1, 0), min(i + 2, grid.nx)):
                walls.has_return[column + grid.nx * row] = 1


@core
def weight_of(walls: Walls, wall: Wall) -> float:
    """How often a wall is picked: `SEEN` if a place along it, one a cell at least, is near a return, else 1."""
    n = 1 + int(length_of(wall) / walls.grid.cell)
    for i in range(n + 1):
        x, y = wall[0] + i / n * (wall[2] - wall[0]), wall[1] + i / n * (wall[3] - wall[1])
        if walls.has_return[cell_at(walls.grid, x, y)] != 0:
            return float(SEEN)
    return 1.0


@core
def fill(graph: Graph, targets: Targets, walls: Walls) -> None:
    """Write the rows of all walls of a graph."""
    n = graph.counts[c.WALLS]
    note_returns(targets, walls)
    walls.counts[TOTAL_WEIGHT] = 0
    for i in range(n):
        write(walls.row, i, wall_of(graph, graph.members[c.WALLS, i]))
        walls.row[i, WEIGHT] = weight_of(walls, wall_in(walls.row, i))
        walls.counts[TOTAL_WEIGHT] += int(walls.row[i, WEIGHT])
        enter_box(walls, i)
    for i in range(n):
        x0, x1, y0, y1 = box_of(wall_in(walls.row, i), 0.0)
        for k in range(n):
            if meets(walls, k, x0, x1, y0, y1) and k != i and are_near(wall_in(walls.row, i), wall_in(walls.row, k)):
                hold_ends(walls.row, i, wall_in(walls.row, k), 1.0)


@core
def start(proposal: Proposal, walls: Walls) -> None:
    """Begin an empty proposal."""
    clear(proposal)
    walls.counts[N_OLD] = 0
    walls.counts[N_NEW] = 0


@core
def take(graph: Graph, proposal: Proposal, walls: Walls, i: int) -> Wall:
    """Remove the wall of a row, and return it."""
    walls.old[walls.counts[N_OLD]] = i
    walls.counts[N_OLD] += 1
    remove_wall(graph, proposal, graph.members[c.WALLS, i])
    return wall_in(walls.row, i)


@core
def put(graph: Graph, proposal: Proposal, walls: Walls, wall: Wall) -> bool:
    """Add a wall; return whether it is one, inside the window."""
    if not add_wall(graph, proposal, wall):
        return False
    k = walls.counts[N_NEW]
    write(walls.new, k, wall)
    walls.new[k, WEIGHT] = weight_of(walls, wall)
    walls.counts[N_NEW] += 1
    return True


@core
def log_picked(walls: Walls) -> tuple[float, float]:
    """Log probability that the first wall that goes was picked, and that the way back picks the first that comes."""
    before = walls.counts[TOTAL_WEIGHT]
    after = float(before)
    for k in range(walls.counts[N_OLD]):
        after -= walls.row[walls.old[k], WEIGHT]
    for k in range(walls.counts[N_NEW]):
        after += walls.new[k, WEIGHT]
    return math.log(walls.row[walls.old[0], WEIGHT] / before), math.log(walls.new[0, WEIGHT] / after)


@core
def goes(walls: Walls, i: int) -> bool:
    """Whether the proposal removes the wall of a row."""
    for k in range(walls.counts[N_OLD]):
        if walls.old[k] == i:
            return True
    return False


@core
def free_ends(rows: Array, i: int) -> int:
    """Number of free ends of a row's wall."""
    return (1 if rows[i, ON_FIRST] <= 0.0 else 0) + (1 if rows[i, ON_SECOND] <= 0.0 else 0)


@core
def freed(walls: Walls, i: int) -> int:
    """Change of the number of free ends of the wall of a row, which stays."""
    wall, change = wall_in(walls.row, i), 0
    for end in range(2):
        x, y, on = wall[2 * end], wall[2 * end + 1], walls.row[i, ON_FIRST + end]
        after = on
        for k in range(walls.counts[N_OLD]):
            if holds(wall_in(walls.row, walls.old[k]), x, y):
                after -= 1.0
        for k in range(walls.counts[N_NEW]):
            if holds(wall_in(walls.new, k), x, y):
                after += 1.0
        change += (1 if after <= 0.0 else 0) - (1 if on <= 0.0 else 0)
    return change


@core
def meet_new(walls: Walls, density: Array, k: int) -> float:
    """Nats that the new wall k takes with those that stay and with new ones before it; counts who holds its ends."""
    wall, cost = wall_in(walls.new, k), 0.0
    for i in range(walls.counts[N_NEW]):
        if i != k and are_near(wall, wall_in(walls.new, i)):
            hold_ends(walls.new, k, wall_in(walls.new, i), 1.0)
            if i < k:
                cost += pair_cost(density, wall, wall_in(walls.new, i))
    return cost


@core
def wall_prior_change(graph: Graph, walls: Walls, density: Array, lines: Array) -> float:
    """Change of the log density of the walls by the proposal."""
    n_old, n_new, change, free = walls.counts[N_OLD], walls.counts[N_NEW], 0.0, 0
    list_nearby(graph, walls)
    for k in range(n_new):
        change += log_alone(density, lines, wall_in(walls.new, k)) - meet_new(walls, density, k)
    for k in range(n_old):
        wall = wall_in(walls.row, walls.old[k])
        change -= log_alone(density, lines, wall)
        free -= free_ends(walls.row, walls.old[k])
        if k == 1 and are_near(wall, wall_in(walls.row, walls.old[0])):
            change += pair_cost(density, wall, wall_in(walls.row, walls.old[0]))
    for m in range(walls.counts[N_NEARBY]):
        i = walls.nearby[m]
        if goes(walls, i):
            continue
        other, is_near = wall_in(walls.row, i), False
        for k in range(n_old):
            wall = wall_in(walls.row, walls.old[k])
            if are_near(wall, other):
                is_near = True
                change += pair_cost(density, wall, other)
        for k in range(n_new):
            wall = wall_in(walls.new, k)
            if are_near(wall, other):
                is_near = True
                change -= pair_cost(density, wall, other)
                hold_ends(walls.new, k, other, 1.0)
        if is_near:
            free += freed(walls, i)
    for k in range(n_new):
        free += free_ends(walls.new, k)
    return change - density[c.FREE_END] * free


@core
def forget(graph: Graph, walls: Walls) -> None:
    """Count anew who holds ends that stay, and take the rows that go out of table and set, each replaced by the last.

    The rows near the proposal are those that :func:`wall_prior_change` listed.
    """
    n_old = walls.counts[N_OLD]
    for m in range(walls.counts[N_NEARBY]):
        i = walls.nearby[m]
        if goes(walls, i):
            continue
        for k in range(n_old):
            if are_near(wall_in(walls.row, i), wall_in(walls.row, walls.old[k])):
                hold_ends(walls.row, i, wall_in(walls.row, walls.old[k]), -1.0)
        for k in range(walls.counts[N_NEW]):
            if are_near(wall_in(walls.row, i), wall_in(walls.new, k)):
                hold_ends(walls.row, i, wall_in(walls.new, k), 1.0)
    for k in range(n_old):
        i, last = walls.old[k], graph.counts[c.WALLS] - 1
        walls.counts[TOTAL_WEIGHT] -= int(walls.row[i, WEIGHT])
        set_remove(graph, c.WALLS, graph.members[c.WALLS, i])
        copy_row(walls.row, last, walls.row, i)
        enter_box(walls, i)
        if k == 0 and n_old == 2 and walls.old[1] == last:
            walls.old[1] = i


@core
def remember(graph: Graph, walls: Walls) -> None:
    """Enter the new walls into the table behind the others; the set of walls follows (:func:`apply_walls`)."""
    n = graph.counts[c.WALLS]
    for k in range(walls.counts[N_NEW]):
        copy_row(walls.new, k, walls.row, n + k)
        enter_box(walls, n + k)
        walls.counts[TOTAL_WEIGHT] += int(walls.new[k, WEIGHT])
