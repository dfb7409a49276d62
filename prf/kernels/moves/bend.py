"""Not in the paper: an edge is bent to a return by a new vertex there, and the reverse, a vertex is taken out.

A split has its foot on the edge. What sticks out past the end of an edge - the corner that one return asks for, a barb,
the far end of a wall - takes a vertex whose foot lies anywhere.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, ends_of, other_end, pick
from prf.kernels.moves.gap import can_face, is_in_window
from prf.kernels.moves.notch_shape import share_after, walls_now
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, place_vertex, turn_at_vertex
from prf.kernels.targets import Targets, first_density, pick_target, point_in, target_of


@core
def propose_bend(
    graph: Graph,
    index: EdgeIndex,
    targets: Targets,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose a new vertex v, uniform in a target, in a uniform edge of W(v)."""
    if graph.counts[c.EDGES] == 0 or tuning[c.AIMED_SHARE] == 0.0:
        return False, 0.0
    x, y = point_in(targets, pick_target(targets, tuning, rng), rng)
    v = place_vertex(graph, proposal, x, y, c.INTERIOR)
    n = walls_now(graph, index, v)
    if n == 0 or not is_in_window(graph, v):
        return False, 0.0
    edge = index.neighbors[int(rng.random() * n)]
    u, w = ends_of(graph, edge)
    drop_edge(proposal, edge)
    join(graph, proposal, u, v)
    join(graph, proposal, v, w)
    for vertex in (u, v, w):
        turn_at_vertex(graph, proposal, vertex)
    density = first_density(targets, tuning, target_of(targets, graph, v)) / n
    if density == 0.0:
        return False, 0.0  # on the border of a target, but for rounding
    return True, math.log(odds[c.UNBEND] / ((graph.counts[c.INTERIOR_VERTICES] + 1) * odds[c.BEND] * density))


@core
def propose_unbend(graph: Graph, proposal: Proposal, odds: np.ndarray, rng: np.random.Generator) -> tuple[bool, float]:
    """Propose to join the neighbours of a uniform interior vertex, which goes; see `unbend_returns`."""
    interior = graph.counts[c.INTERIOR_VERTICES]
    if interior == 0:
        return False, 0.0
    v = pick(graph, c.INTERIOR_VERTICES, rng)
    u = other_end(graph, graph.vertex_edges[v, 0], v)
    w = other_end(graph, graph.vertex_edges[v, 1], v)
    if not can_face(graph, u, w):
        return False, 0.0
    drop_edge(proposal, graph.vertex_edges[v, 0])
    drop_edge(proposal, graph.vertex_edges[v, 1])
    drop_vertex(proposal, v)
    join(graph, proposal, u, w)
    for vertex in (u, v, w):
        turn_at_vertex(graph, proposal, vertex)
    return True, math.log(interior / odds[c.UNBEND])


@core
def unbend_returns(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray
) -> float:
    """Log of odds times density with which a bend would undo the proposed unbending; -inf if none would."""
    if tuning[c.AIMED_SHARE] == 0.0:
        return -math.inf
    v = proposal.old_vertices[0]
    density = first_density(targets, tuning, target_of(targets, graph, v))
    if density == 0.0:
        return -math.inf
    density *= share_after(graph, index, proposal, v)
    return math.log(odds[c.BEND] * density) if density > 0.0 else -math.inf
