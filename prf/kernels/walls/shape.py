"""A wall as five numbers, read from the graph and written into a proposal; what lies inside one."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.state.graph import Graph, ends_of, other_end, outer_edge, set_add
from prf.kernels.state.proposal import Proposal, add_edge, add_vertex, remove_edge, remove_vertex, turn_at_vertex

Wall = tuple[float, float, float, float, float]
"""x and y of the first end and of the second end of the centre line, and the thickness; metres."""


@core
def wall_of(graph: Graph, side: int) -> Wall:
    """The wall whose first side is an edge."""
    v, w = ends_of(graph, side)
    last, far = outer_edge(graph, v, side), outer_edge(graph, w, side)
    u, x = other_end(graph, last, v), other_end(graph, far, w)
    xy = graph.vertex_xy
    ax, ay = 0.5 * (xy[v, 0] + xy[u, 0]), 0.5 * (xy[v, 1] + xy[u, 1])
    bx, by = 0.5 * (xy[w, 0] + xy[x, 0]), 0.5 * (xy[w, 1] + xy[x, 1])
    return ax, ay, bx, by, graph.edge_length[last]


@core
def length_of(wall: Wall) -> float:
    """Length of the centre line."""
    return math.sqrt((wall[2] - wall[0]) ** 2 + (wall[3] - wall[1]) ** 2)


@core
def placed(x: float, y: float, ux: float, uy: float, length: float, thickness: float) -> Wall:
    """The wall from (x, y) along the unit vector u."""
    return x, y, x + length * ux, y + length * uy, thickness


@core
def turned_round(wall: Wall) -> Wall:
    """The same wall from its other end."""
    return wall[2], wall[3], wall[0], wall[1], wall[4]


@core
def is_inside(wall: Wall, x: float, y: float, slack: float) -> bool:
    """Whether a place lies inside a wall, or no farther outside than `slack` along it and across."""
    dx, dy = wall[2] - wall[0], wall[3] - wall[1]
    length = math.sqrt(dx * dx + dy * dy)
    ux, uy = dx / length, dy / length
    along = (x - wall[0]) * ux + (y - wall[1]) * uy
    across = (y - wall[1]) * ux - (x - wall[0]) * uy
    return -slack <= along <= length + slack and abs(across) <= 0.5 * wall[4] + slack


@core
def is_covered(graph: Graph, x: float, y: float) -> bool:
    """Whether a place lies inside a wall of the map."""
    for i in range(graph.counts[c.WALLS]):
        if is_inside(wall_of(graph, graph.members[c.WALLS, i]), x, y, 0.0):
            return True
    return False


@core
def remove_wall(graph: Graph, proposal: Proposal, side: int) -> None:
    """Remove the four sides and the corners of the wall whose first side is an edge."""
    edge, v = side, graph.edge_vertices[side, 0]
    for _ in range(4):
        remove_edge(proposal, edge)
        remove_vertex(proposal, v)
        v = other_end(graph, edge, v)
        edge = outer_edge(graph, v, edge)


@core
def add_wall(graph: Graph, proposal: Proposal, wall: Wall) -> bool:
    """Add the corners and the four sides of a wall; return whether it is one, inside the window."""
    ax, ay, bx, by, thickness = wall
    length = length_of(wall)
    if not length > thickness:
        return False
    half_x, half_y = 0.5 * thickness * (by - ay) / length, -0.5 * thickness * (bx - ax) / length
    window = graph.window
    low_x, high_x = min(ax, bx) - abs(half_x), max(ax, bx) + abs(half_x)
    low_y, high_y = min(ay, by) - abs(half_y), max(ay, by) + abs(half_y)
    if not (window[0] < low_x and high_x < window[2] and window[1] < low_y and high_y < window[3]):
        return False
    v = add_vertex(graph, proposal, ax + half_x, ay + half_y, c.INTERIOR)
    w = add_vertex(graph, proposal, bx + half_x, by + half_y, c.INTERIOR)
    x = add_vertex(graph, proposal, bx - half_x, by - half_y, c.INTERIOR)
    u = add_vertex(graph, proposal, ax - half_x, ay - half_y, c.INTERIOR)
    add_edge(graph, proposal, v, w)
    add_edge(graph, proposal, w, x)
    add_edge(graph, proposal, x, u)
    add_edge(graph, proposal, u, v)
    for corner in (v, w, x, u):
        turn_at_vertex(graph, proposal, corner)
    return True


@core
def write_corners(graph: Graph, side: int, loop: Array) -> None:
    """Write the corners of the wall whose first side is an edge into four rows of `loop`, as it was added."""
    edge, v = side, graph.edge_vertices[side, 0]
    for k in range(4):
        loop[k, 0] = graph.vertex_xy[v, 0]
        loop[k, 1] = graph.vertex_xy[v, 1]
        v = other_end(graph, edge, v)
        edge = outer_edge(graph, v, edge)


@core_entry
def number_walls(graph: Graph) -> None:
    """Enter the first sides of the walls of a new graph, four edges each in their order, into the set of walls.

    The anchor, NONE, tells such a graph: colours follow from the walls, and not from the edges on the way.
    """
    graph.counts[c.ANCHOR_BLACK] = c.NONE
    for i in range(graph.counts[c.EDGES] // 4):
        set_add(graph, c.WALLS, graph.members[c.EDGES, 4 * i])
