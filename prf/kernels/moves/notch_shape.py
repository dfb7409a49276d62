"""The corners of notches in walls: a tooth with its tip in a target, a niche with one of its inner corners there."""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph
from prf.kernels.moves.gap import (
    block_at,
    foot_and_offset,
    is_in_window,
    list_block,
    passes_block,
    place_at_offset,
    place_off_line,
    signed_density,
    signed_reach,
)
from prf.kernels.moves.placing import random_reach, reach_density
from prf.kernels.proposal import N_OLD_EDGES, Proposal, place_vertex
from prf.kernels.targets import Targets, first_density, pick_target, point_in, target_of

NOTCH_RADIUS = 2
"""The wall of a notch is sought in a square of cells that reaches this many cells to each side of the aimed corner."""


@core
def walls_now(graph: Graph, index: EdgeIndex, v: int) -> int:
    """List E(v), the edges through the block of cells round v; return their number."""
    index.mark[0] += 1
    return list_block(index, block_at(index.grid, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1], NOTCH_RADIUS))


@core
def aim_at_wall(
    graph: Graph,
    index: EdgeIndex,
    targets: Targets,
    proposal: Proposal,
    tuning: np.ndarray,
    rng: np.random.Generator,
) -> tuple[int, int, int]:
    """Place a new vertex v in a target that is picked; return it, a uniform edge of E(v), and the size of E(v).

    The edge is NONE where there is none, nothing is aimed, or v lies outside the window.
    """
    if graph.counts[c.EDGES] == 0 or tuning[c.AIMED_SHARE] == 0.0:
        return c.NONE, c.NONE, 0
    x, y = point_in(targets, pick_target(targets, tuning, rng), rng)
    v = place_vertex(graph, proposal, x, y, c.INTERIOR)
    n = walls_now(graph, index, v)
    if n == 0 or not is_in_window(graph, v):
        return v, c.NONE, 0
    return v, index.neighbors[int(rng.random() * n)], n


@core
def share_now(graph: Graph, index: EdgeIndex, e: int, v: int) -> float:
    """1/#E(v) if the edge e is in E(v)."""
    n = walls_now(graph, index, v)
    return 1.0 / n if index.marks[e] == index.mark[0] else 0.0


@core
def share_after(graph: Graph, index: EdgeIndex, proposal: Proposal, v: int) -> float:
    """1/#E(v) in the new map if its one new edge is in E(v)."""
    block = block_at(index.grid, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1], NOTCH_RADIUS)
    if not passes_block(index.grid, proposal, 0, block):
        return 0.0
    index.mark[0] += 1
    for k in range(proposal.counts[N_OLD_EDGES]):
        index.marks[proposal.old_edges[k]] = index.mark[0]
    return 1.0 / (list_block(index, block) + 1)


@core
def tooth_density(graph: Graph, targets: Targets, tuning: np.ndarray, a: int, b: int, p: int, t: int, q: int) -> float:
    """Density of the tip t and of the corners p and q on ab (in this order), if ab was chosen."""
    foot_p, off_p, length = foot_and_offset(graph, a, b, p)
    foot_t, _, _ = foot_and_offset(graph, a, b, t)
    foot_q, off_q, _ = foot_and_offset(graph, a, b, q)
    if not 0.0 < foot_p < foot_t < foot_q < length:
        return 0.0
    near = tuning[c.CUT_REACH]
    reach = tuning[c.JOIN_REACH]
    density = first_density(targets, tuning, target_of(targets, graph, t))
    density *= reach_density(foot_t - foot_p, reach) * reach_density(foot_q - foot_t, reach)
    return density * signed_density(off_p, near) * signed_density(off_q, near)


@core
def niche_density(
    graph: Graph, targets: Targets, tuning: np.ndarray, a: int, b: int, p: int, s: int, t: int, q: int
) -> float:
    """Density of the inner corners s and t, s aimed, and of p and q on ab (in this order), if ab was chosen."""
    foot_p, off_p, length = foot_and_offset(graph, a, b, p)
    foot_q, off_q, _ = foot_and_offset(graph, a, b, q)
    foot_s, depth_s, _ = foot_and_offset(graph, a, b, s)
    foot_t, depth_t, _ = foot_and_offset(graph, a, b, t)
    if not 0.0 < foot_p < foot_q < length or foot_s > foot_t:
        return 0.0
    near = tuning[c.CUT_REACH]
    density = first_density(targets, tuning, target_of(targets, graph, s))
    density *= signed_density(foot_t - foot_s, tuning[c.JOIN_REACH]) * signed_density(depth_t - depth_s, near)
    density *= signed_density(foot_p - foot_s, near) * signed_density(foot_q - foot_t, near)
    return density * signed_density(off_p, near) * signed_density(off_q, near)


@core
def place_tooth(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, a: int, b: int, t: int, rng: np.random.Generator
) -> bool:
    """Place the corners on ab of a tooth with its tip at t as new vertices 1 and 2; False if one cannot stand."""
    foot, _, length = foot_and_offset(graph, a, b, t)
    foot_p = foot - random_reach(rng, tuning[c.JOIN_REACH])
    foot_q = foot + random_reach(rng, tuning[c.JOIN_REACH])
    if not (foot_p > 0.0 and foot_q < length):
        return False
    p = place_off_line(graph, proposal, a, b, foot_p, tuning[c.CUT_REACH], rng)
    q = place_off_line(graph, proposal, a, b, foot_q, tuning[c.CUT_REACH], rng)
    return is_in_window(graph, p) and is_in_window(graph, q)


@core
def place_niche(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, a: int, b: int, s: int, rng: np.random.Generator
) -> bool:
    """Place the other inner corner of a niche with one at s, and those beside s and it on ab, as new vertices 1 to 3.

    False if one of them cannot stand.
    """
    near = tuning[c.CUT_REACH]
    foot_s, depth, length = foot_and_offset(graph, a, b, s)
    foot_t = foot_s + signed_reach(rng, tuning[c.JOIN_REACH])
    t = place_at_offset(graph, proposal, a, b, foot_t, depth + signed_reach(rng, near))
    foot_p = foot_s + signed_reach(rng, near)
    foot_q = foot_t + signed_reach(rng, near)
    if not (0.0 < foot_p < length and 0.0 < foot_q < length):
        return False
    p = place_off_line(graph, proposal, a, b, foot_p, near, rng)
    q = place_off_line(graph, proposal, a, b, foot_q, near, rng)
    return is_in_window(graph, t) and is_in_window(graph, p) and is_in_window(graph, q)
