"""Not in the paper: what stands free before a wall comes to lean on it, and the reverse, it comes to stand free.

Four edges in a ring, such as a cupboard: the front fg, the flanks fp and gq, the back pq. The back goes, the flanks are
led on to corners s and t of the wall ab, of which the piece between them goes. To join the back to the wall
(:mod:`prf.kernels.moves.join_wall`) would leave p and q as corners of the flanks, of which the readings know nothing.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, are_adjacent, ends_of, may_go, pick
from prf.kernels.grid import Grid
from prf.kernels.moves.gap import (
    CUT_RADIUS,
    beyond,
    block_at,
    can_face,
    foot_and_offset,
    is_in_window,
    list_block,
    opposite_now,
    passes_block,
    place_at_offset,
    place_two,
    signed_density,
    signed_reach,
)
from prf.kernels.moves.placing import random_reach, reach_density
from prf.kernels.moves.recolor import begin_list_after
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, turn_at_vertex

# Places of the new edges: both flanks come first when something comes to lean, back and wall when it comes to stand.
FIRST_FLANK = 0
SECOND_FLANK = 1
BACK = 0
WALL = 1
FIRST_SIDE = 2
SECOND_SIDE = 3


@core
def block_behind(grid: Grid, xy: np.ndarray) -> tuple[int, int, int, int]:
    """Block of cells round the middle of the back with ends `xy` (4,), through which its wall passes."""
    return block_at(grid, 0.5 * (xy[0] + xy[2]), 0.5 * (xy[1] + xy[3]), CUT_RADIUS)


@core
def meeting(graph: Graph, a: int, b: int, f: int, p: int) -> float:
    """Distance from a, along the line ab, of its meeting with the line fp; inf if they are parallel."""
    foot_f, off_f, _ = foot_and_offset(graph, a, b, f)
    foot_p, off_p, _ = foot_and_offset(graph, a, b, p)
    if off_f == off_p:
        return math.inf
    return foot_p + (foot_p - foot_f) * off_p / (off_f - off_p)


@core
def leaning_density(graph: Graph, near: float, a: int, b: int, f: int, p: int, s: int) -> float:
    """Density of the corner s on ab to which the flank fp is led."""
    foot, off, _ = foot_and_offset(graph, a, b, s)
    return signed_density(foot - meeting(graph, a, b, f, p), near) * signed_density(off, near)


@core
def corners_density(graph: Graph, near: float, a: int, b: int, f: int, p: int, g: int, q: int, s: int, t: int) -> float:
    """Density of the corners s and t on ab to which the flanks fp and gq are led; 0 out of the order a, s, t, b."""
    foot_s, _, length = foot_and_offset(graph, a, b, s)
    foot_t, _, _ = foot_and_offset(graph, a, b, t)
    if not 0.0 < foot_s < foot_t < length:
        return 0.0
    return leaning_density(graph, near, a, b, f, p, s) * leaning_density(graph, near, a, b, g, q, t)


@core
def standing_density(graph: Graph, tuning: np.ndarray, f: int, s: int, p: int) -> float:
    """Density of the place p to which the corner s is drawn back along its flank sf."""
    along, off, length = foot_and_offset(graph, s, f, p)
    if not 0.0 < along < length:
        return 0.0
    return reach_density(along, tuning[c.STAND_REACH]) * signed_density(off, tuning[c.CUT_REACH])


@core
def are_four(f: int, g: int, a: int, b: int) -> bool:
    """Whether these are four vertices."""
    return f != g and f != a and f != b and g != a and g != b and a != b


@core
def turn_round(
    graph: Graph, proposal: Proposal, f: int, p: int, q: int, g: int, t: int, b: int, a: int, s: int
) -> None:
    """Let the loop run along what goes and what comes in turn."""
    for vertex in (f, p, q, g, t, b, a, s):
        turn_at_vertex(graph, proposal, vertex)


@core
def propose_lean(
    graph: Graph,
    index: EdgeIndex,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose to lead the flanks of a uniform back pq to a uniform wall behind it; `lean_returns` adds the way back."""
    if graph.counts[c.EDGES] < 5:
        return False, 0.0
    back = pick(graph, c.EDGES, rng)
    n = opposite_now(graph, index, back, block_behind(index.grid, graph.edge_xy[back]))
    if n == 0:
        return False, 0.0
    wall = index.neighbors[int(rng.random() * n)]
    p, q = ends_of(graph, back)
    if not (may_go(graph, p) and may_go(graph, q)):
        return False, 0.0
    first, f = beyond(graph, p, back)
    last, g = beyond(graph, q, back)
    a, b = ends_of(graph, wall)
    if not are_four(f, g, a, b) or not are_adjacent(graph, f, g):
        return False, 0.0
    near = tuning[c.CUT_REACH]
    foot_s = meeting(graph, a, b, f, p) + signed_reach(rng, near)
    foot_t = meeting(graph, a, b, g, q) + signed_reach(rng, near)
    if not place_two(graph, proposal, a, b, foot_s, foot_t, graph.edge_length[wall], near, rng):
        return False, 0.0
    s = proposal.new_vertices[0]
    t = proposal.new_vertices[1]
    if foot_s > foot_t:
        a, b = b, a
    density = corners_density(graph, near, a, b, f, p, g, q, s, t)
    if density == 0.0:
        return False, 0.0  # s and t at one foot, but for rounding
    for vertex in (p, q):
        drop_vertex(proposal, vertex)
    for edge in (back, wall, first, last):
        drop_edge(proposal, edge)
    for ends in ((f, s), (g, t), (a, s), (b, t)):
        join(graph, proposal, ends[0], ends[1])
    turn_round(graph, proposal, f, p, q, g, t, b, a, s)
    return True, -math.log(odds[c.LEAN] * density / n)


@core
def lean_returns(graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray) -> float:
    """Log of odds times density with which what leans would be drawn back; -inf if it could not.

    Both moves pick a uniform edge and keep their number, which is left out of both densities.
    """
    f = proposal.new_edges[FIRST_FLANK, 0]
    g = proposal.new_edges[SECOND_FLANK, 0]
    density = standing_density(graph, tuning, f, proposal.new_vertices[0], proposal.old_vertices[0])
    density *= standing_density(graph, tuning, g, proposal.new_vertices[1], proposal.old_vertices[1])
    return math.log(odds[c.STAND] * density) if density > 0.0 else -math.inf


@core
def draw_back(graph: Graph, proposal: Proposal, tuning: np.ndarray, s: int, f: int, rng: np.random.Generator) -> bool:
    """Add a new vertex for the corner s, drawn back along its flank sf; False where it cannot stand."""
    along = random_reach(rng, tuning[c.STAND_REACH])
    p = place_at_offset(graph, proposal, s, f, along, signed_reach(rng, tuning[c.CUT_REACH]))
    return is_in_window(graph, p) and standing_density(graph, tuning, f, s, p) > 0.0


@core
def propose_stand(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to draw what has a uniform front fg back from its wall; `stand_returns` adds the way back."""
    if graph.counts[c.EDGES] < 5:
        return False, 0.0
    front = pick(graph, c.EDGES, rng)
    f, g = ends_of(graph, front)
    if not (may_go(graph, f) and may_go(graph, g)):
        return False, 0.0
    first_flank, s = beyond(graph, f, front)
    second_flank, t = beyond(graph, g, front)
    if s == t or not (may_go(graph, s) and may_go(graph, t)):
        return False, 0.0
    first, a = beyond(graph, s, first_flank)
    last, b = beyond(graph, t, second_flank)
    if a == t or not are_four(f, g, a, b) or not can_face(graph, a, b):
        return False, 0.0
    if not (draw_back(graph, proposal, tuning, s, f, rng) and draw_back(graph, proposal, tuning, t, g, rng)):
        return False, 0.0
    p = proposal.new_vertices[0]
    q = proposal.new_vertices[1]
    for vertex in (s, t):
        drop_vertex(proposal, vertex)
    for edge in (first_flank, second_flank, first, last):
        drop_edge(proposal, edge)
    for ends in ((p, q), (a, b), (f, p), (g, q)):
        join(graph, proposal, ends[0], ends[1])
    turn_round(graph, proposal, f, p, q, g, t, b, a, s)
    density = standing_density(graph, tuning, f, s, p) * standing_density(graph, tuning, g, t, q)
    return True, -math.log(odds[c.STAND] * density)


@core
def stand_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray) -> float:
    """Log of odds times density with which what stands would come to lean again; -inf if it could not."""
    block = block_behind(index.grid, proposal.new_xy[BACK])
    if not passes_block(index.grid, proposal, WALL, block):
        return -math.inf
    p = proposal.new_edges[BACK, 0]
    q = proposal.new_edges[BACK, 1]
    a = proposal.new_edges[WALL, 0]
    b = proposal.new_edges[WALL, 1]
    f = proposal.new_edges[FIRST_SIDE, 0]
    g = proposal.new_edges[SECOND_SIDE, 0]
    s = proposal.old_vertices[0]
    t = proposal.old_vertices[1]
    density = corners_density(graph, tuning[c.CUT_REACH], a, b, f, p, g, q, s, t)
    if density == 0.0:
        return -math.inf
    begin_list_after(graph, index, proposal, BACK)
    n = list_block(index, block) + 1
    return math.log(odds[c.LEAN] * density / n)
