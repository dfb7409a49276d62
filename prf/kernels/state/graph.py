"""The discontinuity graph of one chain: slots for vertices and edges, and the sets that moves sample from."""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.geometry import sine_of_angle


class Graph(NamedTuple):
    """Arrays of one map; a slot is a row that a vertex or an edge keeps as long as it exists."""

    window: Array  # (4,) x_min, y_min, x_max, y_max
    vertex_xy: Array  # (capacity, 2) f8
    vertex_side: Array  # (capacity,) i4 side of a boundary vertex, or INTERIOR
    vertex_edges: Array  # (capacity, 2) i4 edges that end there, NONE where there is none
    vertex_sine: Array  # (capacity,) f8 sin(phi_v) of equation 1
    edge_vertices: Array  # (capacity, 2) i4
    edge_xy: Array  # (capacity, 4) f8 both ends, for tests that should touch one cache line
    edge_length: Array  # (capacity,) f8
    members: Array  # (N_SETS, capacity) i4
    positions: Array  # (N_SETS, capacity) i4 place of a slot in `members`, NONE outside
    free_vertices: Array  # (capacity,) i4 stack
    free_edges: Array  # (capacity,) i4 stack
    counts: Array  # (N_COUNTS,) i8 sizes of the sets, of the stacks, anchor colour, step
    sums: Array  # (N_SUMS,) f8 length, log prior, log likelihood


@core
def set_add(graph: Graph, kind: int, slot: int) -> None:
    """Add a slot to a set; nothing happens if it is there."""
    if graph.positions[kind, slot] == c.NONE:
        n = graph.counts[kind]
        graph.members[kind, n] = slot
        graph.positions[kind, slot] = n
        graph.counts[kind] = n + 1


@core
def set_remove(graph: Graph, kind: int, slot: int) -> None:
    """Remove a slot from a set by moving the last member into its place; nothing happens if it is not there."""
    place = graph.positions[kind, slot]
    if place != c.NONE:
        n = graph.counts[kind] - 1
        last = graph.members[kind, n]
        graph.members[kind, place] = last
        graph.positions[kind, last] = place
        graph.positions[kind, slot] = c.NONE
        graph.counts[kind] = n


@core
def pick(graph: Graph, kind: int, rng: Rng) -> int:
    """Uniform member of a set that is not empty."""
    return graph.members[kind, int(rng.random() * graph.counts[kind])]


@core
def pick_two(graph: Graph, kind: int, rng: Rng) -> tuple[int, int]:
    """Two distinct uniform members of a set that has two."""
    n = graph.counts[kind]
    i = int(rng.random() * n)
    k = int(rng.random() * (n - 1))
    if k >= i:
        k += 1
    return graph.members[kind, i], graph.members[kind, k]


@core
def ends_of(graph: Graph, edge: int) -> tuple[int, int]:
    """Both ends of an edge, in the order in which they are kept."""
    return graph.edge_vertices[edge, 0], graph.edge_vertices[edge, 1]


@core
def distance(graph: Graph, a: int, b: int) -> float:
    """Distance between two vertices."""
    dx = graph.vertex_xy[a, 0] - graph.vertex_xy[b, 0]
    dy = graph.vertex_xy[a, 1] - graph.vertex_xy[b, 1]
    return math.sqrt(dx * dx + dy * dy)


@core
def other_end(graph: Graph, edge: int, vertex: int) -> int:
    """The end of `edge` that is not `vertex`."""
    if graph.edge_vertices[edge, 0] == vertex:
        return graph.edge_vertices[edge, 1]
    return graph.edge_vertices[edge, 0]


@core
def edges_at(graph: Graph, v: int) -> tuple[int, int]:
    """Both edges of an interior vertex."""
    return graph.vertex_edges[v, 0], graph.vertex_edges[v, 1]


@core
def neighbors_of(graph: Graph, v: int) -> tuple[int, int]:
    """The far ends of both edges of an interior vertex."""
    return other_end(graph, graph.vertex_edges[v, 0], v), other_end(graph, graph.vertex_edges[v, 1], v)


@core
def edge_between(graph: Graph, a: int, b: int) -> int:
    """The edge that joins the vertices a and b, or NONE."""
    for k in range(2):
        edge = graph.vertex_edges[a, k]
        if edge != c.NONE and other_end(graph, edge, a) == b:
            return edge
    return c.NONE


@core
def are_adjacent(graph: Graph, a: int, b: int) -> bool:
    """Whether an edge joins the vertices a and b."""
    return edge_between(graph, a, b) != c.NONE


@core
def is_drawn(graph: Graph, edge: int) -> bool:
    """Whether moves may pick an edge: all but the frozen ones of a part of a map (``guards``)."""
    return graph.positions[c.EDGES, edge] != c.NONE


@core
def is_removable(graph: Graph, v: int) -> bool:
    """Whether v lies in the interior and moves may remove it: none of its edges is frozen."""
    return graph.positions[c.INTERIOR_VERTICES, v] != c.NONE


@core
def on_one_side(graph: Graph, a: int, b: int) -> bool:
    """Whether both vertices lie on the same side of the window."""
    return graph.vertex_side[a] != c.INTERIOR and graph.vertex_side[a] == graph.vertex_side[b]


@core
def outer_edge(graph: Graph, v: int, edge: int) -> int:
    """The other of the two edges of an interior vertex v."""
    if graph.vertex_edges[v, 0] == edge:
        return graph.vertex_edges[v, 1]
    return graph.vertex_edges[v, 0]


@core
def beyond(graph: Graph, v: int, edge: int) -> tuple[int, int]:
    """The other of the two edges of an interior vertex v, and the vertex at its far end."""
    other = outer_edge(graph, v, edge)
    return other, other_end(graph, other, v)


@core
def can_join(graph: Graph, a: int, b: int) -> bool:
    """Whether an edge may join a and b: none does yet, and they do not lie on one side."""
    return a != b and not are_adjacent(graph, a, b) and not on_one_side(graph, a, b)


@core
def joins_adjacent_sides(graph: Graph, a: int, b: int) -> bool:
    """Whether the vertices lie on two sides of the window that meet in a corner."""
    on_border = graph.vertex_side[a] != c.INTERIOR and graph.vertex_side[b] != c.INTERIOR
    return on_border and (graph.vertex_side[a] - graph.vertex_side[b]) % 2 != 0


@core
def sine_at_border(side: int, vx: float, vy: float, ax: float, ay: float, length: float) -> float:
    """Sine of the angle between the edge va of given length and the side on which v lies."""
    if side == c.BOTTOM or side == c.TOP:
        return abs(ay - vy) / length
    return abs(ax - vx) / length


@core
def vertex_sine_now(graph: Graph, v: int) -> float:
    """sin(phi_v) from the edges that end in v."""
    vx = graph.vertex_xy[v, 0]
    vy = graph.vertex_xy[v, 1]
    first = graph.vertex_edges[v, 0]
    a = other_end(graph, first, v)
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    if graph.vertex_side[v] != c.INTERIOR:
        return sine_at_border(graph.vertex_side[v], vx, vy, ax, ay, graph.edge_length[first])
    b = other_end(graph, graph.vertex_edges[v, 1], v)
    return sine_of_angle(vx, vy, ax, ay, graph.vertex_xy[b, 0], graph.vertex_xy[b, 1])


@core
def attach(graph: Graph, v: int, edge: int) -> None:
    """Enter `edge` among those that end in v."""
    if graph.vertex_edges[v, 0] == c.NONE:
        graph.vertex_edges[v, 0] = edge
    else:
        graph.vertex_edges[v, 1] = edge


@core
def detach(graph: Graph, v: int, edge: int) -> None:
    """Remove `edge` from those that end in v; the first place stays the occupied one."""
    if graph.vertex_edges[v, 0] == edge:
        graph.vertex_edges[v, 0] = graph.vertex_edges[v, 1]
    graph.vertex_edges[v, 1] = c.NONE


@core
def insert_vertex(graph: Graph, v: int) -> None:
    """Insert the vertex in slot v, whose coordinates and side are set already."""
    graph.vertex_edges[v, 0] = c.NONE
    graph.vertex_edges[v, 1] = c.NONE
    set_add(graph, c.INTERIOR_VERTICES if graph.vertex_side[v] == c.INTERIOR else c.BOUNDARY_VERTICES, v)


@core
def delete_vertex(graph: Graph, v: int) -> None:
    """Delete a vertex: take it out of every set and free its slot."""
    set_remove(graph, c.INTERIOR_VERTICES, v)
    set_remove(graph, c.BOUNDARY_VERTICES, v)
    set_remove(graph, c.TRIANGLE_VERTICES, v)
    set_remove(graph, c.BOUNDARY_APEXES, v)
    graph.free_vertices[graph.counts[c.FREE_VERTICES]] = v
    graph.counts[c.FREE_VERTICES] += 1


@core
def insert_edge(graph: Graph, a: int, b: int, length: float) -> int:
    """Join a and b by a new edge and return its slot."""
    graph.counts[c.FREE_EDGES] -= 1
    edge = graph.free_edges[graph.counts[c.FREE_EDGES]]
    graph.edge_vertices[edge, 0] = a
    graph.edge_vertices[edge, 1] = b
    graph.edge_xy[edge, 0] = graph.vertex_xy[a, 0]
    graph.edge_xy[edge, 1] = graph.vertex_xy[a, 1]
    graph.edge_xy[edge, 2] = graph.vertex_xy[b, 0]
    graph.edge_xy[edge, 3] = graph.vertex_xy[b, 1]
    graph.edge_length[edge] = length
    attach(graph, a, edge)
    attach(graph, b, edge)
    set_add(graph, c.EDGES, edge)
    if joins_adjacent_sides(graph, a, b):
        set_add(graph, c.CORNER_CUTS, edge)
    return edge


@core
def delete_edge(graph: Graph, edge: int) -> None:
    """Delete an edge and free its slot."""
    detach(graph, graph.edge_vertices[edge, 0], edge)
    detach(graph, graph.edge_vertices[edge, 1], edge)
    set_remove(graph, c.EDGES, edge)
    set_remove(graph, c.CORNER_CUTS, edge)
    graph.free_edges[graph.counts[c.FREE_EDGES]] = edge
    graph.counts[c.FREE_EDGES] += 1


@core
def classify_vertex(graph: Graph, v: int) -> None:
    """Bring the membership of v in the sets of triangles and of boundary triangles up to date."""
    in_triangle = False
    is_apex = False
    if graph.vertex_side[v] == c.INTERIOR:
        first, last = edges_at(graph, v)
        a, b = neighbors_of(graph, v)
        if is_drawn(graph, first) and is_drawn(graph, last):
            middle = edge_between(graph, a, b)
            in_triangle = middle != c.NONE and is_drawn(graph, middle)
            in_triangle = in_triangle and is_removable(graph, v) and is_removable(graph, a) and is_removable(graph, b)
            is_apex = on_one_side(graph, a, b)
    if in_triangle:
        set_add(graph, c.TRIANGLE_VERTICES, v)
    else:
        set_remove(graph, c.TRIANGLE_VERTICES, v)
    if is_apex:
        set_add(graph, c.BOUNDARY_APEXES, v)
    else:
        set_remove(graph, c.BOUNDARY_APEXES, v)
