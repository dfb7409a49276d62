"""Not in the paper: a notch in a wall, or a bump on it, that reaches to a return, and the reverse, it is filled.

What lies behind a wall that was drawn past it, or stands at one, comes in one step; by splits its corners would have
to come one by one, each against the readings. Notches are of two kinds: a tooth has one corner off the wall, its tip, a
niche has two.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, ends_of, may_go, other_end, pick
from prf.kernels.moves.gap import beyond, can_face, foot_and_offset, outer_edge
from prf.kernels.moves.notch_shape import (
    aim_at_wall,
    niche_density,
    place_niche,
    place_tooth,
    share_after,
    share_now,
    tooth_density,
)
from prf.kernels.proposal import (
    N_OLD_VERTICES,
    Proposal,
    drop_edge,
    drop_vertex,
    join,
    turn_at_vertex,
)
from prf.kernels.targets import Targets

TOOTH_CORNERS = 3
"""A niche has one more."""


@core
def propose_notch(
    graph: Graph,
    index: EdgeIndex,
    targets: Targets,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose a tooth or a niche (1/2 each) in a uniform edge of E(v), v being uniform in a uniform target."""
    is_tooth = rng.random() < 0.5
    v, e, n = aim_at_wall(graph, index, targets, proposal, tuning, rng)
    if e == c.NONE:
        return False, 0.0
    a, b = ends_of(graph, e)
    drop_edge(proposal, e)
    if is_tooth:
        if not place_tooth(graph, proposal, tuning, a, b, v, rng):
            return False, 0.0
        density = join_tooth(graph, targets, proposal, tuning, a, b) / n
        places = graph.counts[c.INTERIOR_VERTICES] + 3
    else:
        if not place_niche(graph, proposal, tuning, a, b, v, rng):
            return False, 0.0
        density = join_niche(graph, index, targets, proposal, tuning, e)
        places = graph.counts[c.EDGES] + 4
    if density == 0.0:
        return False, 0.0
    return True, math.log(odds[c.FILL] / (places * odds[c.NOTCH] * density))


@core
def join_tooth(graph: Graph, targets: Targets, proposal: Proposal, tuning: np.ndarray, a: int, b: int) -> float:
    """Let the edges of a tooth in ab come; return the density of its corners."""
    t = proposal.new_vertices[0]
    p = proposal.new_vertices[1]
    q = proposal.new_vertices[2]
    join(graph, proposal, p, t)
    join(graph, proposal, t, q)
    join_feet(graph, proposal, a, p, q, b)
    for vertex in (a, p, t, q, b):
        turn_at_vertex(graph, proposal, vertex)
    return tooth_density(graph, targets, tuning, a, b, p, t, q)


@core
def join_niche(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: np.ndarray, e: int
) -> float:
    """Let the edges of a niche in the edge e come; return its density, whichever of its inner corners was aimed."""
    a, b = ends_of(graph, e)
    s = proposal.new_vertices[0]
    t = proposal.new_vertices[1]
    p = proposal.new_vertices[2]
    q = proposal.new_vertices[3]
    if foot_and_offset(graph, a, b, s)[0] > foot_and_offset(graph, a, b, t)[0]:
        a, b = b, a
    join(graph, proposal, p, s)
    join(graph, proposal, s, t)
    join(graph, proposal, t, q)
    join_feet(graph, proposal, a, p, q, b)
    for vertex in (a, p, s, t, q, b):
        turn_at_vertex(graph, proposal, vertex)
    density = niche_density(graph, targets, tuning, a, b, p, s, t, q) * share_now(graph, index, e, s)
    return density + niche_density(graph, targets, tuning, b, a, q, t, s, p) * share_now(graph, index, e, t)


@core
def join_feet(graph: Graph, proposal: Proposal, a: int, p: int, q: int, b: int) -> None:
    """Let the pieces of the wall to either side of a notch come."""
    join(graph, proposal, a, p)
    join(graph, proposal, q, b)


@core
def propose_fill(graph: Graph, proposal: Proposal, odds: np.ndarray, rng: np.random.Generator) -> tuple[bool, float]:
    """Propose to fill a tooth at a uniform vertex or a niche at a uniform edge (1/2 each); see `fill_returns`."""
    if graph.counts[c.INTERIOR_VERTICES] < TOOTH_CORNERS:
        return False, 0.0
    if rng.random() < 0.5:
        t = pick(graph, c.INTERIOR_VERTICES, rng)
        places = graph.counts[c.INTERIOR_VERTICES]
        legal = fill(graph, proposal, t, t, graph.vertex_edges[t, 0], graph.vertex_edges[t, 1])
    else:
        e = pick(graph, c.EDGES, rng)
        s, t = ends_of(graph, e)
        if not (may_go(graph, s) and may_go(graph, t)):
            return False, 0.0
        drop_edge(proposal, e)
        places = graph.counts[c.EDGES]
        legal = fill(graph, proposal, s, t, outer_edge(graph, s, e), outer_edge(graph, t, e))
    return legal, -math.log(odds[c.FILL] / places)


@core
def fill(graph: Graph, proposal: Proposal, s: int, t: int, first: int, last: int) -> bool:
    """Let the corners s and t (one vertex, or joined) of a notch go, and those beside them that end `first`, `last`."""
    p = other_end(graph, first, s)
    q = other_end(graph, last, t)
    if p == q or not (may_go(graph, p) and may_go(graph, q)):
        return False
    outer_p, a = beyond(graph, p, first)
    outer_q, b = beyond(graph, q, last)
    if a == q or not can_face(graph, a, b):
        return False
    for edge in (first, last, outer_p, outer_q):
        drop_edge(proposal, edge)
    for vertex in (p, q, s):
        drop_vertex(proposal, vertex)
    for vertex in (a, p, s):
        turn_at_vertex(graph, proposal, vertex)
    if s != t:
        drop_vertex(proposal, t)
        turn_at_vertex(graph, proposal, t)
    turn_at_vertex(graph, proposal, q)
    turn_at_vertex(graph, proposal, b)
    join(graph, proposal, a, b)
    return True


@core
def fill_returns(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray
) -> float:
    """Log of odds times density with which a notch would undo the proposed filling; -inf if none would."""
    if tuning[c.AIMED_SHARE] == 0.0:
        return -math.inf
    a = proposal.new_edges[0, 0]
    b = proposal.new_edges[0, 1]
    p = proposal.old_vertices[0]
    q = proposal.old_vertices[1]
    s = proposal.old_vertices[2]
    if proposal.counts[N_OLD_VERTICES] == TOOTH_CORNERS:
        density = tooth_density(graph, targets, tuning, a, b, p, s, q) * share_after(graph, index, proposal, s)
    else:
        t = proposal.old_vertices[3]
        density = niche_density(graph, targets, tuning, a, b, p, s, t, q) * share_after(graph, index, proposal, s)
        density += niche_density(graph, targets, tuning, b, a, q, t, s, p) * share_after(graph, index, proposal, t)
    if density == 0.0:
        return -math.inf
    return math.log(odds[c.NOTCH] * density)
