"""Not in the paper: a wall is cut through, and the reverse, a gap between two ends of walls is mended.

Two edges e and f close to one another (the faces of a wall) lose what lies between two places; the loose ends are
joined across by two short edges, the jambs. Without it a chain that has closed a door, or drawn a thin strip across a
room, hardly finds out: each of the four corners would have to come by a split of its own that the readings do not
reward.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, ends_of, pick
from prf.kernels.moves.gap import (
    beyond,
    block_round_cut,
    can_face,
    corners_density,
    foot_and_offset,
    length_after,
    links_after,
    links_now,
    list_block,
    opposite_now,
    passes_block,
    pick_pair,
    place_two,
    signed_reach,
    turn_round_gap,
)
from prf.kernels.moves.placing import random_reach
from prf.kernels.moves.recolor import begin_list_after
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join

# Places of the new edges in a cut's proposal, and of the mended faces in a mend's.
FIRST_JAMB = 0
SECOND_JAMB = 1
FIRST_FACE = 0
SECOND_FACE = 1


@core
def pick_by_length(graph: Graph, rng: np.random.Generator) -> int:
    """Edge with probability in proportion to its length, by rejection from the longest that fits the window."""
    window = graph.window
    width = window[2] - window[0]
    height = window[3] - window[1]
    longest = math.sqrt(width * width + height * height)
    while True:
        edge = pick(graph, c.EDGES, rng)
        if rng.random() * longest < graph.edge_length[edge]:
            return edge


@core
def place_first_corners(graph: Graph, proposal: Proposal, tuning: np.ndarray, e: int, rng: np.random.Generator) -> bool:
    """Place the corners p, q on e as new vertices 0 and 1; False if one cannot stand."""
    a, b = ends_of(graph, e)
    foot_p = rng.random() * graph.edge_length[e]
    foot_q = foot_p + random_reach(rng, tuning[c.BIRTH_REACH])
    return place_two(graph, proposal, a, b, foot_p, foot_q, graph.edge_length[e], tuning[c.CUT_REACH], rng)


@core
def place_second_corners(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, f: int, rng: np.random.Generator
) -> bool:
    """Place the corners s, t on f, opposite to p and q, as new vertices 2 and 3; False if one cannot stand."""
    near = tuning[c.CUT_REACH]
    r, u = ends_of(graph, f)
    shadow_p, _, length = foot_and_offset(graph, r, u, proposal.new_vertices[0])
    shadow_q, _, _ = foot_and_offset(graph, r, u, proposal.new_vertices[1])
    foot_s = shadow_p + signed_reach(rng, near)
    foot_t = shadow_q + signed_reach(rng, near)
    return place_two(graph, proposal, r, u, foot_s, foot_t, length, near, rng)


@core
def propose_cut(
    graph: Graph,
    index: EdgeIndex,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose to cut through a face e and a face f opposite to the cut; the way back is added by `cut_returns`."""
    if graph.counts[c.EDGES] < 2:
        return False, 0.0
    e = pick_by_length(graph, rng)
    if not place_first_corners(graph, proposal, tuning, e, rng):
        return False, 0.0
    a, b = ends_of(graph, e)
    p = proposal.new_vertices[0]
    q = proposal.new_vertices[1]
    n_e = opposite_now(graph, index, e, block_round_cut(graph, index.grid, a, b, p, q))
    if n_e == 0:
        return False, 0.0
    f = index.neighbors[int(rng.random() * n_e)]
    if not place_second_corners(graph, proposal, tuning, f, rng):
        return False, 0.0
    r, u = ends_of(graph, f)
    s = proposal.new_vertices[2]
    t = proposal.new_vertices[3]
    if foot_and_offset(graph, r, u, s)[0] > foot_and_offset(graph, r, u, t)[0]:
        r, u = u, r
    drop_edge(proposal, e)
    drop_edge(proposal, f)
    for jamb in ((p, s), (q, t)):
        join(graph, proposal, jamb[0], jamb[1])
    for piece in ((a, p), (q, b), (r, s), (t, u)):
        join(graph, proposal, piece[0], piece[1])
    turn_round_gap(graph, proposal, a, b, p, q, s, t, r, u)
    forward = corners_density(graph, tuning, a, b, p, q, s, t, r, u) / n_e
    n_f = opposite_now(graph, index, f, block_round_cut(graph, index.grid, r, u, s, t))
    if index.marks[e] == index.mark[0]:
        forward += corners_density(graph, tuning, r, u, s, t, p, q, a, b) / n_f
    return forward > 0.0, -math.log(odds[c.CUT_WALL] * forward / graph.sums[c.TOTAL_LENGTH])


@core
def cut_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, odds: np.ndarray) -> float:
    """Log of odds times density with which a mend would undo the proposed cut; -inf if it could not."""
    density = links_after(graph, index, proposal, FIRST_JAMB, SECOND_JAMB)
    density += links_after(graph, index, proposal, SECOND_JAMB, FIRST_JAMB)
    if density == 0.0:
        return -math.inf
    edges_after = graph.counts[c.EDGES] + 4
    return math.log(odds[c.MEND_WALL] * 0.5 * density / edges_after)


@core
def propose_mend(
    graph: Graph,
    index: EdgeIndex,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose to close the gap between the jambs j, uniform, and k, uniform in M(j); `mend_returns` adds the way back.

    Corners p, s of j and q, t of k go; the faces ab and ru of the mended wall come between their other neighbours.
    """
    edges = graph.counts[c.EDGES]
    j, k, n_j = pick_pair(graph, index, 6, rng)
    if j == c.NONE:
        return False, 0.0
    p, s = ends_of(graph, j)
    q, t = ends_of(graph, k)
    if rng.random() < 0.5:
        q, t = t, q
    if not are_jambs(graph, p, s, q, t):
        return False, 0.0
    from_p, a = beyond(graph, p, j)
    from_s, r = beyond(graph, s, j)
    from_q, b = beyond(graph, q, k)
    from_t, u = beyond(graph, t, k)
    if not are_faces(graph, a, b, r, u, p, s, q, t):
        return False, 0.0
    for vertex in (p, q, s, t):
        drop_vertex(proposal, vertex)
    drop_edge(proposal, j)
    drop_edge(proposal, k)
    for edge in (from_p, from_q, from_s, from_t):
        drop_edge(proposal, edge)
    join(graph, proposal, a, b)
    join(graph, proposal, r, u)
    turn_round_gap(graph, proposal, a, b, p, q, s, t, r, u)
    forward = 1.0 / n_j + links_now(graph, index, k, j)
    return True, -math.log(odds[c.MEND_WALL] * 0.5 * forward / edges)


@core
def are_jambs(graph: Graph, p: int, s: int, q: int, t: int) -> bool:
    """Whether the edges ps and qt, which have no vertex in common, lie in the interior."""
    for v in (p, s, q, t):
        if graph.vertex_side[v] != c.INTERIOR:
            return False
    return True


@core
def are_faces(graph: Graph, a: int, b: int, r: int, u: int, p: int, s: int, q: int, t: int) -> bool:
    """Whether ab and ru may be the faces of a wall whose corners p, s, q, t go."""
    for v in (a, b, r, u):
        if v == p or v == s or v == q or v == t:
            return False
    if a == r or a == u or b == r or b == u:
        return False
    return can_face(graph, a, b) and can_face(graph, r, u)


@core
def opposite_after(
    graph: Graph, index: EdgeIndex, proposal: Proposal, face: int, block: tuple[int, int, int, int]
) -> int:
    """Number of edges opposite to a cut in a mended face; 0 if the other face is none of them."""
    if not passes_block(index.grid, proposal, FIRST_FACE + SECOND_FACE - face, block):
        return 0
    begin_list_after(graph, index, proposal, face)
    return list_block(index, block) + 1


@core
def mend_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray) -> float:
    """Log of odds times density with which a cut would undo the proposed mend; -inf if it could not."""
    a = proposal.new_edges[FIRST_FACE, 0]
    b = proposal.new_edges[FIRST_FACE, 1]
    r = proposal.new_edges[SECOND_FACE, 0]
    u = proposal.new_edges[SECOND_FACE, 1]
    p = proposal.old_vertices[0]
    q = proposal.old_vertices[1]
    s = proposal.old_vertices[2]
    t = proposal.old_vertices[3]
    density = 0.0
    n = opposite_after(graph, index, proposal, FIRST_FACE, block_round_cut(graph, index.grid, a, b, p, q))
    if n > 0:
        density += corners_density(graph, tuning, a, b, p, q, s, t, r, u) / n
    n = opposite_after(graph, index, proposal, SECOND_FACE, block_round_cut(graph, index.grid, r, u, s, t))
    if n > 0:
        density += corners_density(graph, tuning, r, u, s, t, p, q, a, b) / n
    if density == 0.0:
        return -math.inf
    return math.log(odds[c.CUT_WALL] * density / length_after(graph, proposal))
