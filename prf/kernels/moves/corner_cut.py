"""Figure 2 (c): birth of an edge that cuts off a corner of the window, and its death."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.graph import Graph, ends_of, pick
from prf.kernels.moves.placing import (
    area,
    corner_between,
    distance_to_corner,
    is_on_side,
    position_from_corner,
    position_on_side,
    random_position,
    random_reach,
    reach_density,
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
    turn_at,
    turn_at_vertex,
)


@core
def birth_density(graph: Graph, tuning: Array, u: int, v: int) -> float:
    """Density with which a birth proposes the edge between u and v on adjacent sides.

    A corner in four, then a point on each of its sides: uniform, or at a random reach from the corner.
    """
    s = graph.vertex_side[u]
    t = graph.vertex_side[v]
    median = tuning[c.BIRTH_REACH]
    at_u = position_on_side(s, graph.vertex_xy[u, 0], graph.vertex_xy[u, 1])
    at_v = position_on_side(t, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])
    local = reach_density(distance_to_corner(graph.window, s, t, at_u), median)
    local *= reach_density(distance_to_corner(graph.window, t, s, at_v), median)
    uniform = 1.0 / area(graph.window)
    return 0.25 * (tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform)


@core
def place_on_side(graph: Graph, proposal: Proposal, side: int, other: int, local_median: float, rng: Rng) -> int:
    """New vertex on `side`: near its corner with `other` if `local_median` is positive, else uniform."""
    if local_median > 0.0:
        position = position_from_corner(graph.window, side, other, random_reach(rng, local_median))
    else:
        position = random_position(graph.window, side, rng)
    x, y = side_point(graph.window, side, position)
    return add_vertex(graph, proposal, x, y, side)


@core
def turn_round_corner(graph: Graph, proposal: Proposal, u: int, v: int) -> None:
    """Run the loop from u past the corner of its side with that of v."""
    turn_at_vertex(graph, proposal, u)
    x, y = corner_between(graph.window, graph.vertex_side[u], graph.vertex_side[v])
    turn_at(proposal, x, y)
    turn_at_vertex(graph, proposal, v)


@core
def propose_birth(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose an edge across a uniform corner."""
    median = tuning[c.BIRTH_REACH] if rng.random() < tuning[c.LOCAL_SHARE] else 0.0
    side = int(4.0 * rng.random())
    other = (side + 1) % 4
    u = place_on_side(graph, proposal, side, other, median, rng)
    v = place_on_side(graph, proposal, other, side, median, rng)
    for vertex in (u, v):
        at = graph.vertex_side[vertex]
        position = position_on_side(at, graph.vertex_xy[vertex, 0], graph.vertex_xy[vertex, 1])
        if not is_on_side(graph.window, at, position):
            return ILLEGAL
    turn_round_corner(graph, proposal, u, v)
    add_edge(graph, proposal, u, v)
    return True, math.log(birth_density(graph, tuning, u, v)), -math.log(graph.counts[c.CORNER_CUTS] + 1)


@core
def propose_death(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove a uniform edge that joins adjacent sides."""
    cuts = graph.counts[c.CORNER_CUTS]
    if cuts == 0:
        return ILLEGAL
    edge = pick(graph, c.CORNER_CUTS, rng)
    u, v = ends_of(graph, edge)
    remove_edge(proposal, edge)
    remove_vertex(proposal, u)
    remove_vertex(proposal, v)
    turn_round_corner(graph, proposal, u, v)
    return True, -math.log(cuts), math.log(birth_density(graph, tuning, u, v))
