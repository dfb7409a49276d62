"""Not in the paper: a notch in a wall, or a bump on it, that reaches to a return, and the reverse, it is filled.

What lies behind a wall that was drawn past it, or before one, is added in one step; by splits its corners would be
added one by one, each against the readings. Notches are of two kinds: a tooth has one corner off the wall, its tip, a
niche has two.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.moves.aiming import aim_at_wall, share_now, share_of_new
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, beyond, can_join, ends_of, is_removable, other_end, outer_edge, pick
from prf.kernels.state.proposal import ILLEGAL, N_OLD_VERTICES, Densities, Proposal
from prf.kernels.state.targets import Targets, first_density, target_of

TOOTH_CORNERS = 3
"""A niche has one more."""


@core
def tooth_density(graph: Graph, targets: Targets, tuning: Array, a: int, b: int, p: int, t: int, q: int) -> float:
    """Density of the tip t and of the corners p and q on ab (in this order), if ab was chosen."""
    foot_p, off_p, length = placing.foot_and_offset(graph, a, b, p)
    foot_t, _, _ = placing.foot_and_offset(graph, a, b, t)
    foot_q, off_q, _ = placing.foot_and_offset(graph, a, b, q)
    if not 0.0 < foot_p < foot_t < foot_q < length:
        return 0.0
    near = tuning[c.CUT_REACH]
    reach = tuning[c.JOIN_REACH]
    density = first_density(targets, tuning, target_of(targets, graph, t))
    density *= placing.reach_density(foot_t - foot_p, reach) * placing.reach_density(foot_q - foot_t, reach)
    return density * placing.signed_density(off_p, near) * placing.signed_density(off_q, near)


@core
def niche_density(
    graph: Graph, targets: Targets, tuning: Array, a: int, b: int, p: int, s: int, t: int, q: int
) -> float:
    """Density of the inner corners s and t, s aimed, and of p and q on ab (in this order), if ab was chosen."""
    foot_p, off_p, length = placing.foot_and_offset(graph, a, b, p)
    foot_q, off_q, _ = placing.foot_and_offset(graph, a, b, q)
    foot_s, depth_s, _ = placing.foot_and_offset(graph, a, b, s)
    foot_t, depth_t, _ = placing.foot_and_offset(graph, a, b, t)
    if not 0.0 < foot_p < foot_q < length or foot_s > foot_t:
        return 0.0
    near = tuning[c.CUT_REACH]
    density = first_density(targets, tuning, target_of(targets, graph, s))
    beyond_s = placing.signed_density(foot_t - foot_s, tuning[c.JOIN_REACH])
    density *= beyond_s * placing.signed_density(depth_t - depth_s, near)
    density *= placing.signed_density(foot_p - foot_s, near) * placing.signed_density(foot_q - foot_t, near)
    return density * placing.signed_density(off_p, near) * placing.signed_density(off_q, near)


@core
def place_tooth(graph: Graph, proposal: Proposal, tuning: Array, a: int, b: int, t: int, rng: Rng) -> bool:
    """Place the corners on ab of a tooth with its tip at t as new vertices 1 and 2; False if one is off ab."""
    foot, _, length = placing.foot_and_offset(graph, a, b, t)
    foot_p = foot - placing.random_reach(rng, tuning[c.JOIN_REACH])
    foot_q = foot + placing.random_reach(rng, tuning[c.JOIN_REACH])
    return placing.place_two(graph, proposal, a, b, foot_p, foot_q, length, tuning[c.CUT_REACH], rng)


@core
def place_niche(graph: Graph, proposal: Proposal, tuning: Array, a: int, b: int, s: int, rng: Rng) -> bool:
    """Place the other inner corner of a niche with one at s, and those beside s and it on ab, as new vertices 1 to 3.

    False if one of them is off ab or the window.
    """
    near = tuning[c.CUT_REACH]
    foot_s, depth, length = placing.foot_and_offset(graph, a, b, s)
    foot_t = foot_s + placing.signed_reach(rng, tuning[c.JOIN_REACH])
    t = placing.place_at_offset(graph, proposal, a, b, foot_t, depth + placing.signed_reach(rng, near))
    foot_p = foot_s + placing.signed_reach(rng, near)
    foot_q = foot_t + placing.signed_reach(rng, near)
    on_wall = placing.place_two(graph, proposal, a, b, foot_p, foot_q, length, near, rng)
    return on_wall and placing.is_in_window(graph, t)


@core
def propose_notch(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng
) -> Densities:
    """Propose a tooth or a niche (1/2 each) in a uniform edge of E(v), v being uniform in a uniform target."""
    is_tooth = rng.random() < 0.5
    v, e, n = aim_at_wall(graph, index, targets, proposal, tuning, rng)
    if e == c.NONE:
        return ILLEGAL
    a, b = ends_of(graph, e)
    edit.remove_edge(proposal, e)
    if is_tooth:
        if not place_tooth(graph, proposal, tuning, a, b, v, rng):
            return ILLEGAL
        density = join_tooth(graph, targets, proposal, tuning, a, b) / n
        places = graph.counts[c.INTERIOR_VERTICES] + 3
    else:
        if not place_niche(graph, proposal, tuning, a, b, v, rng):
            return ILLEGAL
        density = join_niche(graph, index, targets, proposal, tuning, e)
        places = graph.counts[c.EDGES] + 4
    if density == 0.0:
        return ILLEGAL
    return True, math.log(0.5 * density), math.log(0.5 / places)


@core
def join_tooth(graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, a: int, b: int) -> float:
    """Add the edges of a tooth in ab; return the density of its corners."""
    t, p, q = proposal.new_vertices[0], proposal.new_vertices[1], proposal.new_vertices[2]
    edit.add_edges(graph, proposal, ((p, t), (t, q), (a, p), (q, b)))
    edit.turn_round(graph, proposal, (a, p, t, q, b))
    return tooth_density(graph, targets, tuning, a, b, p, t, q)


@core
def join_niche(graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, e: int) -> float:
    """Add the edges of a niche in the edge e; return its density, whichever of its inner corners was aimed."""
    a, b = ends_of(graph, e)
    added = proposal.new_vertices
    s, t, p, q = added[0], added[1], added[2], added[3]
    if placing.foot_and_offset(graph, a, b, s)[0] > placing.foot_and_offset(graph, a, b, t)[0]:
        a, b = b, a
    edit.add_edges(graph, proposal, ((p, s), (s, t), (t, q), (a, p), (q, b)))
    edit.turn_round(graph, proposal, (a, p, s, t, q, b))
    density = niche_density(graph, targets, tuning, a, b, p, s, t, q) * share_now(graph, index, e, s)
    return density + niche_density(graph, targets, tuning, b, a, q, t, s, p) * share_now(graph, index, e, t)


@core
def propose_fill(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng
) -> Densities:
    """Propose to fill a tooth at a uniform vertex or a niche at a uniform edge (1/2 each)."""
    if graph.counts[c.INTERIOR_VERTICES] < TOOTH_CORNERS:
        return ILLEGAL
    if rng.random() < 0.5:
        t = pick(graph, c.INTERIOR_VERTICES, rng)
        places = graph.counts[c.INTERIOR_VERTICES]
        legal = fill(graph, proposal, t, t, graph.vertex_edges[t, 0], graph.vertex_edges[t, 1])
    else:
        e = pick(graph, c.EDGES, rng)
        s, t = ends_of(graph, e)
        if not (is_removable(graph, s) and is_removable(graph, t)):
            return ILLEGAL
        edit.remove_edge(proposal, e)
        places = graph.counts[c.EDGES]
        legal = fill(graph, proposal, s, t, outer_edge(graph, s, e), outer_edge(graph, t, e))
    if not legal:
        return ILLEGAL
    return True, math.log(0.5 / places), log_reverse_of_fill(graph, index, targets, proposal, tuning)


@core
def fill(graph: Graph, proposal: Proposal, s: int, t: int, first: int, last: int) -> bool:
    """Remove the corners s, t (one vertex, or joined) of a notch, and those beside them that end `first`, `last`."""
    p = other_end(graph, first, s)
    q = other_end(graph, last, t)
    if p == q or not (is_removable(graph, p) and is_removable(graph, q)):
        return False
    outer_p, a = beyond(graph, p, first)
    outer_q, b = beyond(graph, q, last)
    if a == q or not can_join(graph, a, b):
        return False
    edit.remove_edges(proposal, (first, last, outer_p, outer_q))
    edit.remove_vertices(proposal, (p, q, s))
    edit.turn_round(graph, proposal, (a, p, s))
    if s != t:
        edit.remove_vertex(proposal, t)
        edit.turn_at_vertex(graph, proposal, t)
    edit.turn_round(graph, proposal, (q, b))
    edit.add_edge(graph, proposal, a, b)
    return True


@core
def log_reverse_of_fill(graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array) -> float:
    """Log density with which a notch would undo the proposed filling; -inf if none would."""
    edit.find_cells(index.grid, proposal)
    if tuning[c.AIMED_SHARE] == 0.0:
        return -math.inf
    a, b = edit.new_ends(proposal, 0)
    p, q, s = proposal.old_vertices[0], proposal.old_vertices[1], proposal.old_vertices[2]
    if proposal.counts[N_OLD_VERTICES] == TOOTH_CORNERS:
        density = tooth_density(graph, targets, tuning, a, b, p, s, q) * share_of_new(graph, index, proposal, s)
    else:
        t = proposal.old_vertices[3]
        density = niche_density(graph, targets, tuning, a, b, p, s, t, q) * share_of_new(graph, index, proposal, s)
        density += niche_density(graph, targets, tuning, b, a, q, t, s, p) * share_of_new(graph, index, proposal, t)
    return placing.log_or_minus_infinity(0.5 * density)
