"""Not in the paper: an edge is joined to one near it across two new corners, and the reverse, two walls part.

Edge uv goes; its ends are led to two new corners p and q on the edge ab, of which the piece between them goes. What
stands free is so attached to a wall, without corners that would first have to stand on the wall by chance. p and q,
once they stand, may as well have been corners on uv to which a and b were led: densities count both.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, ends_of, may_go, other_end
from prf.kernels.moves.gap import (
    beyond,
    can_face,
    foot_and_offset,
    links_after,
    links_now,
    pick_pair,
    place_two,
    signed_density,
    signed_reach,
)
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, turn_at_vertex

# Places of the new edges in a join's proposal, those of u and v and those of a and b, and in a parting's.
FIRST_LINK = 0
SECOND_LINK = 1
FIRST_PIECE = 2
SECOND_PIECE = 3
FREE_EDGE = 0
FACE = 1


@core
def corners_density(graph: Graph, tuning: np.ndarray, u: int, v: int, a: int, b: int, p: int, q: int) -> float:
    """Density of the corners p and q on ab to which u and v are led; 0 where they are not drawn so."""
    foot_p, off_p, length = foot_and_offset(graph, a, b, p)
    foot_q, off_q, _ = foot_and_offset(graph, a, b, q)
    if not 0.0 < foot_p < foot_q < length:
        return 0.0
    foot_u, _, _ = foot_and_offset(graph, a, b, u)
    foot_v, _, _ = foot_and_offset(graph, a, b, v)
    near = tuning[c.CUT_REACH]
    aside = signed_density(off_p, near) * signed_density(off_q, near)
    reach = tuning[c.JOIN_REACH]
    return aside * signed_density(foot_p - foot_u, reach) * signed_density(foot_q - foot_v, reach)


@core
def propose_join(
    graph: Graph,
    index: EdgeIndex,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose to join a uniform edge e to a uniform f in M(e); `join_returns` adds the way back."""
    edges = graph.counts[c.EDGES]
    e, f, n = pick_pair(graph, index, 2, rng)
    if e == c.NONE:
        return False, 0.0
    u, v = ends_of(graph, e)
    a, b = ends_of(graph, f)
    foot_p = foot_and_offset(graph, a, b, u)[0] + signed_reach(rng, tuning[c.JOIN_REACH])
    foot_q, _, length = foot_and_offset(graph, a, b, v)
    foot_q += signed_reach(rng, tuning[c.JOIN_REACH])
    if not place_two(graph, proposal, a, b, foot_p, foot_q, length, tuning[c.CUT_REACH], rng):
        return False, 0.0
    p = proposal.new_vertices[0]
    q = proposal.new_vertices[1]
    if foot_p > foot_q:
        a, b = b, a
    drop_edge(proposal, e)
    drop_edge(proposal, f)
    for new in ((u, p), (v, q), (a, p), (q, b)):
        join(graph, proposal, new[0], new[1])
    for vertex in (u, p, a, b, q, v):
        turn_at_vertex(graph, proposal, vertex)
    density = corners_density(graph, tuning, u, v, a, b, p, q) / n
    density += corners_density(graph, tuning, a, b, u, v, p, q) * links_now(graph, index, f, e)
    if density == 0.0:
        return False, 0.0  # p and q at one foot, but for rounding
    return True, -math.log(odds[c.JOIN_WALL] * density / edges)


@core
def join_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, odds: np.ndarray) -> float:
    """Log of odds times density with which a parting would undo the proposed join; -inf if it could not."""
    density = links_after(graph, index, proposal, FIRST_LINK, SECOND_LINK)
    density += links_after(graph, index, proposal, SECOND_LINK, FIRST_LINK)
    density += links_after(graph, index, proposal, FIRST_PIECE, SECOND_PIECE)
    density += links_after(graph, index, proposal, SECOND_PIECE, FIRST_PIECE)
    if density == 0.0:
        return -math.inf
    edges_after = graph.counts[c.EDGES] + 2
    return math.log(odds[c.PART_WALL] * 0.25 * density / edges_after)


@core
def random_end(graph: Graph, edge: int, rng: np.random.Generator) -> int:
    """One of the two ends of an edge, 1/2 each."""
    return graph.edge_vertices[edge, 0 if rng.random() < 0.5 else 1]


@core
def propose_part(
    graph: Graph, index: EdgeIndex, proposal: Proposal, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to let the links j = up, uniform, and k = vq, uniform in M(j), go with p and q.

    `part_returns` adds the way back.
    """
    edges = graph.counts[c.EDGES]
    j, k, n_j = pick_pair(graph, index, 4, rng)
    if j == c.NONE:
        return False, 0.0
    p = random_end(graph, j, rng)
    q = random_end(graph, k, rng)
    if not (may_go(graph, p) and may_go(graph, q)):
        return False, 0.0
    u = other_end(graph, j, p)
    v = other_end(graph, k, q)
    first, a = beyond(graph, p, j)
    last, b = beyond(graph, q, k)
    if a == q or a == v or b == u or not can_face(graph, a, b) or not can_face(graph, u, v):
        return False, 0.0
    drop_vertex(proposal, p)
    drop_vertex(proposal, q)
    drop_edge(proposal, j)
    drop_edge(proposal, k)
    drop_edge(proposal, first)
    drop_edge(proposal, last)
    join(graph, proposal, u, v)
    join(graph, proposal, a, b)
    for vertex in (u, p, a, b, q, v):
        turn_at_vertex(graph, proposal, vertex)
    forward = 1.0 / n_j + links_now(graph, index, k, j)
    forward += links_now(graph, index, first, last) + links_now(graph, index, last, first)
    return True, -math.log(odds[c.PART_WALL] * 0.25 * forward / edges)


@core
def part_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray) -> float:
    """Log of odds times density with which a join would undo the proposed parting; -inf if it could not."""
    u = proposal.new_edges[FREE_EDGE, 0]
    v = proposal.new_edges[FREE_EDGE, 1]
    a = proposal.new_edges[FACE, 0]
    b = proposal.new_edges[FACE, 1]
    p = proposal.old_vertices[0]
    q = proposal.old_vertices[1]
    density = corners_density(graph, tuning, u, v, a, b, p, q)
    if density > 0.0:
        density *= links_after(graph, index, proposal, FREE_EDGE, FACE)
    other = corners_density(graph, tuning, a, b, u, v, p, q)
    if other > 0.0:
        density += other * links_after(graph, index, proposal, FACE, FREE_EDGE)
    if density == 0.0:
        return -math.inf
    return math.log(odds[c.JOIN_WALL] * density / (graph.counts[c.EDGES] - 2))
