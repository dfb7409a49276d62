"""Not in the paper: an edge is joined to a side of the window, and the reverse, two edges come off a side.

Edge uv goes; its ends are led to two new vertices p and q on one side. What lies beyond the walls that were seen, and
reaches out of the window, so comes and goes in one step.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.graph import Graph, ends_of, other_end, pick, pick_two
from prf.kernels.moves.gap import can_face, signed_density, signed_reach
from prf.kernels.moves.placing import is_on_side, position_on_side, side_point
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, place_vertex, turn_at_vertex

DOCK_REACH = 0.25
"""Edges are joined to a side whose middles lie nearer to it than so many times the scale, 1/(4p): their mean length."""


@core
def position_of(graph: Graph, side: int, v: int) -> float:
    """Coordinate along a side of the foot of a vertex on it."""
    return position_on_side(side, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])


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
def landing_density(graph: Graph, tuning: np.ndarray, u: int, v: int, p: int, q: int) -> float:
    """Density of p and q on their side when u is led to p and v to q."""
    side = graph.vertex_side[p]
    first = signed_density(position_of(graph, side, p) - position_of(graph, side, u), tuning[c.JOIN_REACH])
    return first * signed_density(position_of(graph, side, q) - position_of(graph, side, v), tuning[c.JOIN_REACH])


@core
def land(graph: Graph, proposal: Proposal, side: int, u: int, reach: float, rng: np.random.Generator) -> int:
    """New vertex on a side near the foot of u, or NONE beyond its ends."""
    position = position_of(graph, side, u) + signed_reach(rng, reach)
    if not is_on_side(graph.window, side, position):
        return c.NONE
    x, y = side_point(graph.window, side, position)
    return place_vertex(graph, proposal, x, y, side)


@core
def turn_round(graph: Graph, proposal: Proposal, u: int, p: int, q: int, v: int) -> None:
    """Let the loop run from u to the side at p, along it to q and back to v."""
    turn_at_vertex(graph, proposal, u)
    turn_at_vertex(graph, proposal, p)
    turn_at_vertex(graph, proposal, q)
    turn_at_vertex(graph, proposal, v)


@core
def propose_dock(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to join a uniform edge to the side that is near its middle."""
    edges = graph.counts[c.EDGES]
    if edges == 0:
        return False, 0.0
    e = pick(graph, c.EDGES, rng)
    u, v = ends_of(graph, e)
    side = side_near(graph, u, v, DOCK_REACH / tuning[c.SCALE])
    if side == c.NONE or graph.vertex_side[u] == side or graph.vertex_side[v] == side:
        return False, 0.0
    p = land(graph, proposal, side, u, tuning[c.JOIN_REACH], rng)
    if p == c.NONE:
        return False, 0.0
    q = land(graph, proposal, side, v, tuning[c.JOIN_REACH], rng)
    if q == c.NONE:
        return False, 0.0
    drop_edge(proposal, e)
    join(graph, proposal, u, p)
    join(graph, proposal, v, q)
    turn_round(graph, proposal, u, p, q, v)
    boundary = graph.counts[c.BOUNDARY_VERTICES] + 2.0
    forward = odds[c.DOCK] * landing_density(graph, tuning, u, v, p, q) / edges
    return True, math.log(odds[c.UNDOCK] * 2.0 / (boundary * (boundary - 1.0) * forward))


@core
def propose_undock(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to let two distinct uniform boundary vertices go, and to join their neighbours."""
    boundary = graph.counts[c.BOUNDARY_VERTICES]
    if boundary < 2:
        return False, 0.0
    p, q = pick_two(graph, c.BOUNDARY_VERTICES, rng)
    if graph.vertex_side[p] != graph.vertex_side[q]:
        return False, 0.0
    first = graph.vertex_edges[p, 0]
    last = graph.vertex_edges[q, 0]
    u = other_end(graph, first, p)
    v = other_end(graph, last, q)
    if not can_face(graph, u, v) or side_near(graph, u, v, DOCK_REACH / tuning[c.SCALE]) != graph.vertex_side[p]:
        return False, 0.0
    drop_edge(proposal, first)
    drop_edge(proposal, last)
    drop_vertex(proposal, p)
    drop_vertex(proposal, q)
    join(graph, proposal, u, v)
    turn_round(graph, proposal, u, p, q, v)
    edges_after = graph.counts[c.EDGES] - 1
    backward = odds[c.DOCK] * landing_density(graph, tuning, u, v, p, q) / edges_after
    return True, math.log(backward * boundary * (boundary - 1.0) / (2.0 * odds[c.UNDOCK]))
