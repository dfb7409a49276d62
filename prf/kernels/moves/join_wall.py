"""Not in the paper: an edge is joined to one near it across two new corners, and the reverse, two walls part.

Edge uv is removed; its ends are joined to two new corners p and q on the edge ab, of which the piece between them is
removed. So a free shape is attached to a wall, without corners that would first have to be put on it by chance. p and
q may as well have been corners on uv to which a and b were joined: densities count both.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves.nearby_edges import links_after, links_now, pick_pair
from prf.kernels.moves.placing import foot_and_offset, log_or_minus_infinity, place_two, signed_density, signed_reach
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, beyond, can_join, ends_of, is_removable, other_end
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal

# Places of the new edges in a join's proposal, those of u and v and those of a and b, and in a parting's.
FIRST_LINK = 0
SECOND_LINK = 1
FIRST_PIECE = 2
SECOND_PIECE = 3
FREE_EDGE = 0
FACE = 1


@core
def link_density(graph: Graph, tuning: Array, u: int, v: int, a: int, b: int, p: int, q: int) -> float:
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
def propose_join(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to join a uniform edge e to a uniform f in M(e)."""
    edges = graph.counts[c.EDGES]
    e, f, n = pick_pair(graph, index, 2, rng)
    if e == c.NONE:
        return ILLEGAL
    u, v = ends_of(graph, e)
    a, b = ends_of(graph, f)
    foot_p = foot_and_offset(graph, a, b, u)[0] + signed_reach(rng, tuning[c.JOIN_REACH])
    foot_q, _, length = foot_and_offset(graph, a, b, v)
    foot_q += signed_reach(rng, tuning[c.JOIN_REACH])
    if not place_two(graph, proposal, a, b, foot_p, foot_q, length, tuning[c.CUT_REACH], rng):
        return ILLEGAL
    p, q = proposal.new_vertices[0], proposal.new_vertices[1]
    if foot_p > foot_q:
        a, b = b, a
    edit.remove_edge(proposal, e)
    edit.remove_edge(proposal, f)
    edit.add_edges(graph, proposal, ((u, p), (v, q), (a, p), (q, b)))
    edit.turn_round(graph, proposal, (u, p, a, b, q, v))
    density = link_density(graph, tuning, u, v, a, b, p, q) / n
    density += link_density(graph, tuning, a, b, u, v, p, q) * links_now(graph, index, f, e)
    if density == 0.0:
        return ILLEGAL  # p and q at one foot, but for rounding
    return True, math.log(density / edges), log_reverse_of_join(graph, index, proposal)


@core
def log_reverse_of_join(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Log density with which a parting would undo the proposed join; -inf if it could not."""
    edit.find_cells(index.grid, proposal)
    density = links_after(graph, index, proposal, FIRST_LINK, SECOND_LINK)
    density += links_after(graph, index, proposal, SECOND_LINK, FIRST_LINK)
    density += links_after(graph, index, proposal, FIRST_PIECE, SECOND_PIECE)
    density += links_after(graph, index, proposal, SECOND_PIECE, FIRST_PIECE)
    edges_after = graph.counts[c.EDGES] + 2
    return log_or_minus_infinity(0.25 * density / edges_after)


@core
def random_end(graph: Graph, edge: int, rng: Rng) -> int:
    """One of the two ends of an edge, 1/2 each."""
    return graph.edge_vertices[edge, 0 if rng.random() < 0.5 else 1]


@core
def propose_part(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """Propose to remove the links j = up, uniform, and k = vq, uniform in M(j), with p and q."""
    edges = graph.counts[c.EDGES]
    j, k, n_j = pick_pair(graph, index, 4, rng)
    if j == c.NONE:
        return ILLEGAL
    p = random_end(graph, j, rng)
    q = random_end(graph, k, rng)
    if not (is_removable(graph, p) and is_removable(graph, q)):
        return ILLEGAL
    u = other_end(graph, j, p)
    v = other_end(graph, k, q)
    first, a = beyond(graph, p, j)
    last, b = beyond(graph, q, k)
    if a == q or a == v or b == u or not can_join(graph, a, b) or not can_join(graph, u, v):
        return ILLEGAL
    edit.remove_vertices(proposal, (p, q))
    edit.remove_edges(proposal, (j, k))
    edit.remove_edges(proposal, (first, last))
    edit.add_edge(graph, proposal, u, v)
    edit.add_edge(graph, proposal, a, b)
    edit.turn_round(graph, proposal, (u, p, a, b, q, v))
    forward = 1.0 / n_j + links_now(graph, index, k, j)
    forward += links_now(graph, index, first, last) + links_now(graph, index, last, first)
    return True, math.log(0.25 * forward / edges), log_reverse_of_parting(graph, index, proposal, tuning)


@core
def log_reverse_of_parting(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: Array) -> float:
    """Log density with which a join would undo the proposed parting; -inf if it could not."""
    edit.find_cells(index.grid, proposal)
    (u, v), (a, b) = edit.new_ends(proposal, FREE_EDGE), edit.new_ends(proposal, FACE)
    p, q = proposal.old_vertices[0], proposal.old_vertices[1]
    density = link_density(graph, tuning, u, v, a, b, p, q)
    if density > 0.0:
        density *= links_after(graph, index, proposal, FREE_EDGE, FACE)
    other = link_density(graph, tuning, a, b, u, v, p, q)
    if other > 0.0:
        density += other * links_after(graph, index, proposal, FACE, FREE_EDGE)
    return log_or_minus_infinity(density / (graph.counts[c.EDGES] - 2))
