"""Not in the paper: a wall is cut through, and the reverse, a gap between two ends of walls is mended.

Two edges e and f close to one another (the faces of a wall) lose what lies between two places; the loose ends are
joined across by two short edges, the jambs. Without it a chain that has closed a door, or drawn a thin strip across a
room, hardly finds out: each of the four corners would need a split of its own that the readings do not
reward.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.moves.nearby_edges import (
    Block,
    block_at,
    count_near_after,
    links_after,
    links_now,
    list_near,
    pick_pair,
)
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, beyond, can_join, ends_of, pick
from prf.kernels.state.grid import Grid
from prf.kernels.state.proposal import ILLEGAL, N_NEW_EDGES, N_OLD_EDGES, Densities, Proposal

CUT_RADIUS = 1
"""The other face of a wall is searched in a square of cells that reaches so many beyond the middle of the cut."""

# Places of the new edges in a cut's proposal, and of the mended faces in a mend's.
FIRST_JAMB = 0
SECOND_JAMB = 1
FIRST_FACE = 0
SECOND_FACE = 1


@core
def gap_density(graph: Graph, tuning: Array, a: int, b: int, p: int, q: int, s: int, t: int, r: int, u: int) -> float:
    """Density of the corners p, q on the face ab (in this order) and s, t on the face ru, if ab was chosen first.

    The foot of q lies a reach further than that of p; those of s and t lie near the feet of p and q on the line ru; all
    four lie a little off their lines. 0 where a foot is off its face or out of order. The foot of p is uniform on ab,
    which is left out: faces are chosen in proportion to their lengths, so that it is uniform on all edges together.
    """
    near = tuning[c.CUT_REACH]
    foot_p, off_p, length = placing.foot_and_offset(graph, a, b, p)
    foot_q, off_q, _ = placing.foot_and_offset(graph, a, b, q)
    foot_s, off_s, other_length = placing.foot_and_offset(graph, r, u, s)
    foot_t, off_t, _ = placing.foot_and_offset(graph, r, u, t)
    if not (0.0 < foot_p < foot_q < length and 0.0 < foot_s < foot_t < other_length):
        return 0.0
    shadow_p, _, _ = placing.foot_and_offset(graph, r, u, p)
    shadow_q, _, _ = placing.foot_and_offset(graph, r, u, q)
    density = placing.reach_density(foot_q - foot_p, tuning[c.BIRTH_REACH])
    density *= placing.signed_density(off_p, near) * placing.signed_density(off_q, near)
    density *= placing.signed_density(foot_s - shadow_p, near) * placing.signed_density(foot_t - shadow_q, near)
    return density * placing.signed_density(off_s, near) * placing.signed_density(off_t, near)


@core
def block_round_cut(graph: Graph, grid: Grid, a: int, b: int, p: int, q: int) -> Block:
    """Block of cells round the middle of the cut from p to q in the face ab."""
    foot_p, _, length = placing.foot_and_offset(graph, a, b, p)
    foot_q, _, _ = placing.foot_and_offset(graph, a, b, q)
    share = 0.5 * (foot_p + foot_q) / length
    x = graph.vertex_xy[a, 0] + share * (graph.vertex_xy[b, 0] - graph.vertex_xy[a, 0])
    y = graph.vertex_xy[a, 1] + share * (graph.vertex_xy[b, 1] - graph.vertex_xy[a, 1])
    return block_at(grid, x, y, CUT_RADIUS)


@core
def length_after(graph: Graph, proposal: Proposal) -> float:
    """Total length of the edges in the new map."""
    length = graph.sums[c.TOTAL_LENGTH]
    for k in range(proposal.counts[N_OLD_EDGES]):
        length -= graph.edge_length[proposal.old_edges[k]]
    for k in range(proposal.counts[N_NEW_EDGES]):
        length += proposal.new_length[k]
    return length


@core
def pick_by_length(graph: Graph, rng: Rng) -> int:
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
def place_first_corners(graph: Graph, proposal: Proposal, tuning: Array, e: int, rng: Rng) -> bool:
    """Place the corners p, q on e as new vertices 0 and 1; False if one is off its edge."""
    a, b = ends_of(graph, e)
    foot_p = rng.random() * graph.edge_length[e]
    foot_q = foot_p + placing.random_reach(rng, tuning[c.BIRTH_REACH])
    return placing.place_two(graph, proposal, a, b, foot_p, foot_q, graph.edge_length[e], tuning[c.CUT_REACH], rng)


@core
def place_second_corners(graph: Graph, proposal: Proposal, tuning: Array, f: int, rng: Rng) -> bool:
    """Place the corners s, t on f, opposite to p and q, as new vertices 2 and 3; False if one is off its edge."""
    near = tuning[c.CUT_REACH]
    r, u = ends_of(graph, f)
    shadow_p, _, length = placing.foot_and_offset(graph, r, u, proposal.new_vertices[0])
    shadow_q, _, _ = placing.foot_and_offset(graph, r, u, proposal.new_vertices[1])
    foot_s = shadow_p + placing.signed_reach(rng, near)
    foot_t = shadow_q + placing.signed_reach(rng, near)
    return placing.place_two(graph, proposal, r, u, foot_s, foot_t, length, near, rng)


@core
def propose_cut(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to cut through a face e and a face f opposite to the cut."""
    if graph.counts[c.EDGES] < 2:
        return ILLEGAL
    e = pick_by_length(graph, rng)
    if not place_first_corners(graph, proposal, tuning, e, rng):
        return ILLEGAL
    a, b = ends_of(graph, e)
    p, q = proposal.new_vertices[0], proposal.new_vertices[1]
    n_e = list_near(graph, index, block_round_cut(graph, index.grid, a, b, p, q), e)
    if n_e == 0:
        return ILLEGAL
    f = index.neighbors[int(rng.random() * n_e)]
    if not place_second_corners(graph, proposal, tuning, f, rng):
        return ILLEGAL
    r, u = ends_of(graph, f)
    s, t = proposal.new_vertices[2], proposal.new_vertices[3]
    if placing.foot_and_offset(graph, r, u, s)[0] > placing.foot_and_offset(graph, r, u, t)[0]:
        r, u = u, r
    edit.remove_edge(proposal, e)
    edit.remove_edge(proposal, f)
    edit.add_edges(graph, proposal, ((p, s), (q, t), (a, p), (q, b), (r, s), (t, u)))
    edit.turn_round(graph, proposal, (a, p, s, r, u, t, q, b))
    forward = gap_density(graph, tuning, a, b, p, q, s, t, r, u) / n_e
    n_f = list_near(graph, index, block_round_cut(graph, index.grid, r, u, s, t), f)
    if index.marks[e] == index.mark[0]:
        forward += gap_density(graph, tuning, r, u, s, t, p, q, a, b) / n_f
    if forward == 0.0:
        return ILLEGAL  # rounding put a foot off its face
    return True, math.log(forward / graph.sums[c.TOTAL_LENGTH]), log_reverse_of_cut(graph, index, proposal)


@core
def log_reverse_of_cut(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Log density with which a mend would undo the proposed cut; -inf if it could not."""
    edit.find_cells(index.grid, proposal)
    density = links_after(graph, index, proposal, FIRST_JAMB, SECOND_JAMB)
    density += links_after(graph, index, proposal, SECOND_JAMB, FIRST_JAMB)
    edges_after = graph.counts[c.EDGES] + 4
    return placing.log_or_minus_infinity(0.5 * density / edges_after)


@core
def propose_mend(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to close the gap between the jambs j, uniform, and k, uniform in M(j).

    Corners p, s of j and q, t of k are removed; the faces ab and ru of the mended wall join their other neighbours.
    """
    edges = graph.counts[c.EDGES]
    j, k, n_j = pick_pair(graph, index, 6, rng)
    if j == c.NONE:
        return ILLEGAL
    p, s = ends_of(graph, j)
    q, t = ends_of(graph, k)
    if rng.random() < 0.5:
        q, t = t, q
    if not are_jambs(graph, p, s, q, t):
        return ILLEGAL
    from_p, a = beyond(graph, p, j)
    from_s, r = beyond(graph, s, j)
    from_q, b = beyond(graph, q, k)
    from_t, u = beyond(graph, t, k)
    if not are_faces(graph, a, b, r, u, p, s, q, t):
        return ILLEGAL
    edit.remove_vertices(proposal, (p, q, s, t))
    edit.remove_edges(proposal, (j, k))
    edit.remove_edges(proposal, (from_p, from_q, from_s, from_t))
    edit.add_edge(graph, proposal, a, b)
    edit.add_edge(graph, proposal, r, u)
    edit.turn_round(graph, proposal, (a, p, s, r, u, t, q, b))
    forward = 1.0 / n_j + links_now(graph, index, k, j)
    return True, math.log(0.5 * forward / edges), log_reverse_of_mend(graph, index, proposal, tuning)


@core
def are_jambs(graph: Graph, p: int, s: int, q: int, t: int) -> bool:
    """Whether the edges ps and qt, which have no vertex in common, lie in the interior."""
    for v in (p, s, q, t):
        if graph.vertex_side[v] != c.INTERIOR:
            return False
    return True


@core
def are_faces(graph: Graph, a: int, b: int, r: int, u: int, p: int, s: int, q: int, t: int) -> bool:
    """Whether ab and ru may be the faces of a wall whose corners p, s, q, t are removed."""
    for v in (a, b, r, u):
        if v == p or v == s or v == q or v == t:
            return False
    if a == r or a == u or b == r or b == u:
        return False
    return can_join(graph, a, b) and can_join(graph, r, u)


@core
def log_reverse_of_mend(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array) -> float:
    """Log density with which a cut would undo the proposed mend; -inf if it could not."""
    edit.find_cells(index.grid, proposal)
    (a, b), (r, u) = edit.new_ends(proposal, FIRST_FACE), edit.new_ends(proposal, SECOND_FACE)
    removed = proposal.old_vertices
    p, q, s, t = removed[0], removed[1], removed[2], removed[3]
    density = 0.0
    block = block_round_cut(graph, index.grid, a, b, p, q)
    n = count_near_after(graph, index, proposal, block, FIRST_FACE, SECOND_FACE)
    if n > 0:
        density += gap_density(graph, tuning, a, b, p, q, s, t, r, u) / n
    block = block_round_cut(graph, index.grid, r, u, s, t)
    n = count_near_after(graph, index, proposal, block, SECOND_FACE, FIRST_FACE)
    if n > 0:
        density += gap_density(graph, tuning, r, u, s, t, p, q, a, b) / n
    return placing.log_or_minus_infinity(density / length_after(graph, proposal))
