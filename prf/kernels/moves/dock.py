"""Not in the paper: an edge is joined to a side of the window, and the reverse.

Edge uv is removed; its ends are joined to two new vertices p and q on one side. What lies behind the visible walls and
reaches out of the window is so added and removed in one step.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves.placing import is_on_side, position_of, side_point, signed_density, signed_reach
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, can_join, ends_of, other_end, pick, pick_two
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal


@core
def side_near(graph: Graph, u: int, v: int, limit: float) -> int:
    """The side nearest to the middle of uv, or NONE if it is no nearer than `limit`."""
    x = 0.5 * (graph.vertex_xy[u, 0] + graph.vertex_xy[v, 0])
    y = 0.5 * (graph.vertex_xy[u, 1] + graph.vertex_xy[v, 1])
    window = graph.window
    nearest = c.NONE
    for side, distance in enumerate((y - window[1], window[2] - x, window[3] - y, x - window[0])):
        if distance < limit:
            limit = distance
            nearest = side
    return nearest


@core
def landing_density(graph: Graph, tuning: Array, u: int, v: int, p: int, q: int) -> float:
    """Density of p and q on their side when u is led to p and v to q."""
    side = graph.vertex_side[p]
    first = signed_density(position_of(graph, side, p) - position_of(graph, side, u), tuning[c.JOIN_REACH])
    return first * signed_density(position_of(graph, side, q) - position_of(graph, side, v), tuning[c.JOIN_REACH])


@core
def land(graph: Graph, proposal: Proposal, side: int, u: int, reach: float, rng: Rng) -> bool:
    """Add a vertex on a side near the foot of u; False beyond its ends."""
    position = position_of(graph, side, u) + signed_reach(rng, reach)
    if not is_on_side(graph.window, side, position):
        return False
    x, y = side_point(graph.window, side, position)
    edit.add_vertex(graph, proposal, x, y, side)
    return True


@core
def propose_dock(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to join a uniform edge to the side that is near its middle."""
    edges = graph.counts[c.EDGES]
    if edges == 0:
        return ILLEGAL
    e = pick(graph, c.EDGES, rng)
    u, v = ends_of(graph, e)
    side = side_near(graph, u, v, tuning[c.DOCK_REACH])
    if side == c.NONE or graph.vertex_side[u] == side or graph.vertex_side[v] == side:
        return ILLEGAL
    for end in (u, v):
        if not land(graph, proposal, side, end, tuning[c.JOIN_REACH], rng):
            return ILLEGAL
    p, q = proposal.new_vertices[0], proposal.new_vertices[1]
    edit.remove_edge(proposal, e)
    edit.add_edge(graph, proposal, u, p)
    edit.add_edge(graph, proposal, v, q)
    edit.turn_round(graph, proposal, (u, p, q, v))
    boundary = graph.counts[c.BOUNDARY_VERTICES] + 2.0
    log_forward = math.log(landing_density(graph, tuning, u, v, p, q) / edges)
    return True, log_forward, math.log(2.0 / (boundary * (boundary - 1.0)))


@core
def propose_undock(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove two distinct uniform boundary vertices, and to join their neighbours."""
    boundary = graph.counts[c.BOUNDARY_VERTICES]
    if boundary < 2:
        return ILLEGAL
    p, q = pick_two(graph, c.BOUNDARY_VERTICES, rng)
    if graph.vertex_side[p] != graph.vertex_side[q]:
        return ILLEGAL
    first, last = graph.vertex_edges[p, 0], graph.vertex_edges[q, 0]
    u = other_end(graph, first, p)
    v = other_end(graph, last, q)
    if not can_join(graph, u, v) or side_near(graph, u, v, tuning[c.DOCK_REACH]) != graph.vertex_side[p]:
        return ILLEGAL
    edit.remove_edges(proposal, (first, last))
    edit.remove_vertices(proposal, (p, q))
    edit.add_edge(graph, proposal, u, v)
    edit.turn_round(graph, proposal, (u, p, q, v))
    edges_after = graph.counts[c.EDGES] - 1
    log_reverse = math.log(landing_density(graph, tuning, u, v, p, q) / edges_after)
    return True, math.log(2.0 / (boundary * (boundary - 1.0))), log_reverse
