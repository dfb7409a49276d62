"""Figure 2 (b): birth of a triangle on a side of the window, and its death."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.graph import Graph, distance, other_end, pick
from prf.kernels.moves.interior_triangle import uniform_vertex, vertex_near
from prf.kernels.moves.placing import (
    area,
    is_inside,
    is_on_side,
    near_density,
    perimeter,
    random_position,
    random_reach,
    random_side,
    reach_density,
    side_length,
    side_point,
)
from prf.kernels.proposal import (
    ILLEGAL,
    Densities,
    Proposal,
    add_edge,
    add_vertex,
    remove_edge,
    remove_vertex,
    turn_at_vertex,
)


@core
def birth_density(graph: Graph, tuning: Array, u: int, v: int, apex: int) -> float:
    """Density with which a birth proposes the triangle of the unordered boundary vertices u, v and the apex.

    Uniform: side in proportion to its length, two uniform points on it (either order), a uniform apex. Local:
    either of the two may have been the first (uniform on the border); the other lies to the left or the right of
    it at a random reach; the apex lies round the first.
    """
    side = graph.vertex_side[u]
    median = tuning[c.BIRTH_REACH]
    spread = 0.5 * reach_density(distance(graph, u, v), median)
    near = near_density(distance(graph, u, apex), median) + near_density(distance(graph, v, apex), median)
    border = perimeter(graph.window)
    local = spread * near / border
    uniform = 2.0 / (border * side_length(graph.window, side) * area(graph.window))
    return tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform


@core
def propose_birth(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose two points on one side and an apex inside the window."""
    window = graph.window
    is_local = rng.random() < tuning[c.LOCAL_SHARE]
    side = random_side(window, rng)
    first = random_position(window, side, rng)
    if is_local:
        reach = random_reach(rng, tuning[c.BIRTH_REACH])
        second = first + (reach if rng.random() < 0.5 else -reach)
        if not is_on_side(window, side, second):
            return ILLEGAL
    else:
        second = random_position(window, side, rng)
    x, y = side_point(window, side, first)
    u = add_vertex(graph, proposal, x, y, side)
    x, y = side_point(window, side, second)
    v = add_vertex(graph, proposal, x, y, side)
    if is_local:
        apex = vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
        if not is_inside(window, graph.vertex_xy[apex, 0], graph.vertex_xy[apex, 1]):
            return ILLEGAL
    else:
        apex = uniform_vertex(graph, proposal, rng)
    for vertex in (u, apex, v):
        turn_at_vertex(graph, proposal, vertex)
    add_edge(graph, proposal, u, apex)
    add_edge(graph, proposal, apex, v)
    log_reverse = -math.log(graph.counts[c.BOUNDARY_APEXES] + 1)
    return True, math.log(birth_density(graph, tuning, u, v, apex)), log_reverse


@core
def propose_death(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove a uniform triangle on a side."""
    triangles = graph.counts[c.BOUNDARY_APEXES]
    if triangles == 0:
        return ILLEGAL
    apex = pick(graph, c.BOUNDARY_APEXES, rng)
    first = graph.vertex_edges[apex, 0]
    last = graph.vertex_edges[apex, 1]
    u = other_end(graph, first, apex)
    v = other_end(graph, last, apex)
    remove_edge(proposal, first)
    remove_edge(proposal, last)
    for vertex in (u, apex, v):
        remove_vertex(proposal, vertex)
        turn_at_vertex(graph, proposal, vertex)
    return True, -math.log(triangles), math.log(birth_density(graph, tuning, u, v, apex))
