"""Not in the paper: an edge is bent to a return by a new vertex there, and the reverse, a vertex is taken out.

A split has its foot on the edge. What sticks out past the end of an edge - the corner that one return asks for, a barb,
the far end of a wall - takes a vertex whose foot lies anywhere.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, other_end, pick
from prf.kernels.moves.gap import can_face
from prf.kernels.moves.notch_shape import aim_at_wall, share_after
from prf.kernels.moves.split_edge import lead_through, take_out
from prf.kernels.proposal import Proposal
from prf.kernels.targets import Targets, first_density, target_of


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
    """Propose a new vertex v, uniform in a target, in a uniform edge of E(v)."""
    v, edge, n = aim_at_wall(graph, index, targets, proposal, tuning, rng)
    if edge == c.NONE:
        return False, 0.0
    lead_through(graph, proposal, edge, v)
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
    take_out(graph, proposal, u, v, w)
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
