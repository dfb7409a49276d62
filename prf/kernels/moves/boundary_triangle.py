"""Figure 2 (b): birth of a triangle on a side of the window, and its death."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, distance, edges_at, neighbors_of, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal


@core
def birth_density(graph: Graph, tuning: Array, u: int, v: int, apex: int) -> float:
    """Density with which a birth proposes the triangle of the unordered boundary vertices u, v and the apex.

    Uniform: side in proportion to its length, two uniform points on it (either order), a uniform apex. Local:
    either of the two may have been the first (uniform on the border); the other lies to the left or the right of
    it at a random reach; the apex lies round the first.
    """
    side = graph.vertex_side[u]
    median = tuning[c.BIRTH_REACH]
    spread = 0.5 * placing.reach_density(distance(graph, u, v), median)
    near = placing.near_density(distance(graph, u, apex), median)
    near += placing.near_density(distance(graph, v, apex), median)
    border = placing.perimeter(graph.window)
    local = spread * near / border
    uniform = 2.0 / (border * placing.side_length(graph.window, side) * placing.area(graph.window))
    return tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform


@core
def propose_birth(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose two points on one side and an apex inside the window."""
    window = graph.window
    is_local = rng.random() < tuning[c.LOCAL_SHARE]
    side = placing.random_side(window, rng)
    first = placing.random_position(window, side, rng)
    if is_local:
        second = first + placing.signed_reach(rng, tuning[c.BIRTH_REACH])
        if not placing.is_on_side(window, side, second):
            return ILLEGAL
    else:
        second = placing.random_position(window, side, rng)
    x, y = placing.side_point(window, side, first)
    u = edit.add_vertex(graph, proposal, x, y, side)
    x, y = placing.side_point(window, side, second)
    v = edit.add_vertex(graph, proposal, x, y, side)
    if is_local:
        apex = placing.vertex_near(graph, proposal, u, tuning[c.BIRTH_REACH], rng)
        if not placing.is_in_window(graph, apex):
            return ILLEGAL
    else:
        apex = placing.uniform_vertex(graph, proposal, rng)
    edit.turn_round(graph, proposal, (u, apex, v))
    edit.add_edge(graph, proposal, u, apex)
    edit.add_edge(graph, proposal, apex, v)
    log_reverse = -math.log(graph.counts[c.BOUNDARY_APEXES] + 1)
    return True, math.log(birth_density(graph, tuning, u, v, apex)), log_reverse


@core
def propose_death(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove a uniform triangle on a side."""
    triangles = graph.counts[c.BOUNDARY_APEXES]
    if triangles == 0:
        return ILLEGAL
    apex = pick(graph, c.BOUNDARY_APEXES, rng)
    u, v = neighbors_of(graph, apex)
    edit.remove_edges(proposal, edges_at(graph, apex))
    edit.remove_vertices(proposal, (u, apex, v))
    edit.turn_round(graph, proposal, (u, apex, v))
    return True, -math.log(triangles), math.log(birth_density(graph, tuning, u, v, apex))
