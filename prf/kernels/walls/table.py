"""The walls of a map side by side while a chain runs, and the change of their log density by a proposal.

The table follows from the graph and is filled anew at the start of every run, row i being the wall of the i-th member
of the set of walls. A proposal names rows that go and walls that come, two of each at most.
"""

from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.graph import Graph, set_remove
from prf.kernels.state.proposal import Proposal, clear
from prf.kernels.walls.law import are_near, holds, log_alone, pair_cost
from prf.kernels.walls.shape import Wall, add_wall, remove_wall, wall_of

# Columns of ``Walls.row`` after the five numbers of a wall.
ON_FIRST = 5  # how many other walls hold its first end
ON_SECOND = 6
N_ROW = 7

# Entries of ``Walls.counts``.
N_OLD = 0
N_NEW = 1
N_WALL_COUNTS = 2
MOST_WALLS = 2
"""No proposal removes or adds more walls than this."""


class Walls(NamedTuple):
    """Rows of the walls of a map, and of those that a proposal adds."""

    row: Array  # (capacity, N_ROW) f8
    new: Array  # (MOST_WALLS, N_ROW) f8
    old: Array  # (MOST_WALLS,) i8 rows that go
    counts: Array  # (N_WALL_COUNTS,) i8


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
def fill(graph: Graph, walls: Walls) -> None:
    """Write the rows of all walls of a graph."""
    n = graph.counts[c.WALLS]
    for i in range(n):
        write(walls.row, i, wall_of(graph, graph.members[c.WALLS, i]))
    for i in range(n):
        for k in range(n):
            if k != i and are_near(wall_in(walls.row, i), wall_in(walls.row, k)):
                hold_ends(walls.row, i, wall_in(walls.row, k), 1.0)


@core
def start(proposal: Proposal, walls: Walls) -> None:
    """Begin an empty proposal."""
    clear(proposal)
    walls.counts[:] = 0


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
    write(walls.new, walls.counts[N_NEW], wall)
    walls.counts[N_NEW] += 1
    return add_wall(graph, proposal, wall)


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
    for k in range(n_new):
        change += log_alone(density, lines, wall_in(walls.new, k)) - meet_new(walls, density, k)
    for k in range(n_old):
        wall = wall_in(walls.row, walls.old[k])
        change -= log_alone(density, lines, wall)
        free -= free_ends(walls.row, walls.old[k])
        if k == 1 and are_near(wall, wall_in(walls.row, walls.old[0])):
            change += pair_cost(density, wall, wall_in(walls.row, walls.old[0]))
    for i in range(graph.counts[c.WALLS]):
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
    """Take the rows that go out of the table, and their walls out of the set, each replaced by the last."""
    n_old = walls.counts[N_OLD]
    for i in range(graph.counts[c.WALLS]):
        if goes(walls, i):
            continue
        for k in range(n_old):
            if are_near(wall_in(walls.row, i), wall_in(walls.row, walls.old[k])):
                hold_ends(walls.row, i, wall_in(walls.row, walls.old[k]), -1.0)
    for k in range(n_old):
        i, last = walls.old[k], graph.counts[c.WALLS] - 1
        set_remove(graph, c.WALLS, graph.members[c.WALLS, i])
        copy_row(walls.row, last, walls.row, i)
        if k == 0 and n_old == 2 and walls.old[1] == last:
            walls.old[1] = i


@core
def remember(graph: Graph, walls: Walls) -> None:
    """Enter the new walls into the table behind the others; the set of walls follows (:func:`apply_walls`)."""
    n = graph.counts[c.WALLS]
    for k in range(walls.counts[N_NEW]):
        for i in range(n):
            if are_near(wall_in(walls.row, i), wall_in(walls.new, k)):
                hold_ends(walls.row, i, wall_in(walls.new, k), 1.0)
    for k in range(walls.counts[N_NEW]):
        copy_row(walls.new, k, walls.row, n + k)
