"""Figure 2 (c): birth of an edge that cuts off a corner of the window, and its death."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, ends_of, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal


@core
def birth_density(graph: Graph, tuning: Array, u: int, v: int) -> float:
    """Density with which a birth proposes the edge between u and v on adjacent sides.

    A corner in four, then a point on each of its sides: uniform, or at a random reach from the corner.
    """
    s = graph.vertex_side[u]
    t = graph.vertex_side[v]
    median = tuning[c.BIRTH_REACH]
    from_corner = placing.distance_to_corner(graph.window, s, t, placing.position_of(graph, s, u))
    other_from_corner = placing.distance_to_corner(graph.window, t, s, placing.position_of(graph, t, v))
    local = placing.reach_density(from_corner, median) * placing.reach_density(other_from_corner, median)
    uniform = 1.0 / placing.area(graph.window)
    return 0.25 * (tuning[c.LOCAL_SHARE] * local + (1.0 - tuning[c.LOCAL_SHARE]) * uniform)


@core
def place_on_side(graph: Graph, proposal: Proposal, side: int, other: int, local_median: float, rng: Rng) -> int:
    """New vertex on `side`: near its corner with `other` if `local_median` is positive, else uniform."""
    if local_median > 0.0:
        position = placing.position_from_corner(graph.window, side, other, placing.random_reach(rng, local_median))
    else:
        position = placing.random_position(graph.window, side, rng)
    x, y = placing.side_point(graph.window, side, position)
    return edit.add_vertex(graph, proposal, x, y, side)


@core
def turn_round_corner(graph: Graph, proposal: Proposal, u: int, v: int) -> None:
    """Run the loop from u past the corner of its side with that of v."""
    edit.turn_at_vertex(graph, proposal, u)
    x, y = placing.corner_between(graph.window, graph.vertex_side[u], graph.vertex_side[v])
    edit.turn_at(proposal, x, y)
    edit.turn_at_vertex(graph, proposal, v)


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
        if not placing.is_on_side(graph.window, at, placing.position_of(graph, at, vertex)):
            return ILLEGAL
    turn_round_corner(graph, proposal, u, v)
    edit.add_edge(graph, proposal, u, v)
    return True, math.log(birth_density(graph, tuning, u, v)), -math.log(graph.counts[c.CORNER_CUTS] + 1)


@core
def propose_death(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove a uniform edge that joins adjacent sides."""
    cuts = graph.counts[c.CORNER_CUTS]
    if cuts == 0:
        return ILLEGAL
    edge = pick(graph, c.CORNER_CUTS, rng)
    u, v = ends_of(graph, edge)
    edit.remove_edge(proposal, edge)
    edit.remove_vertices(proposal, (u, v))
    turn_round_corner(graph, proposal, u, v)
    return True, -math.log(cuts), math.log(birth_density(graph, tuning, u, v))
