"""Not in the paper: a wall is cut through, and the reverse, a gap between two ends of walls is mended.

Two edges e and f that share a cell (the faces of a wall) lose what lies between two places; the loose ends are joined
across by two short edges, the jambs. Without it a chain that has closed a door, or drawn a thin strip across a room,
hardly finds out: each of the four corners would have to come by a split of its own that the readings do not reward.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, are_adjacent, on_one_side, other_end, pick
from prf.kernels.grid import Grid, axis_index
from prf.kernels.moves.placing import is_inside, random_reach, reach_density
from prf.kernels.moves.recolor import (
    begin_list_after,
    mark_edges_at,
    neighbors_after,
    neighbors_now,
    new_edges_share_cell,
    note_neighbor,
)
from prf.kernels.proposal import (
    N_NEW_EDGES,
    Proposal,
    drop_edge,
    drop_vertex,
    join,
    place_vertex,
    turn_at_vertex,
)

BLOCK_RADIUS = 3
"""A jamb's partner is sought in a square of cells that reaches this many cells to each side of its middle."""

# Places of the new edges in a cut's proposal, and of the mended faces in a mend's.
FIRST_JAMB = 0
SECOND_JAMB = 1
FIRST_FACE = 0
SECOND_FACE = 1


@core
def foot_and_offset(graph: Graph, a: int, b: int, v: int) -> tuple[float, float, float]:
    """Distance of v's foot from a along the line ab, signed offset from it, and the length of ab."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    ex = graph.vertex_xy[b, 0] - ax
    ey = graph.vertex_xy[b, 1] - ay
    length = math.sqrt(ex * ex + ey * ey)
    vx = graph.vertex_xy[v, 0] - ax
    vy = graph.vertex_xy[v, 1] - ay
    return (vx * ex + vy * ey) / length, (ex * vy - ey * vx) / length, length


@core
def signed_density(x: float, median: float) -> float:
    """Density of a random reach to either side."""
    return 0.5 * reach_density(abs(x), median)


@core
def signed_reach(rng: np.random.Generator, median: float) -> float:
    """Random reach to either side."""
    reach = random_reach(rng, median)
    return reach if rng.random() < 0.5 else -reach


@core
def corners_density(
    graph: Graph, tuning: np.ndarray, a: int, b: int, p: int, q: int, s: int, t: int, r: int, u: int
) -> float:
    """Density of the corners p, q on the face ab (in this order) and s, t on the face ru, if ab was chosen first.

    The foot of p is uniform on ab and that of q a reach further; those of s and t lie near the feet of p and q on the
    line ru; all four lie a little off their lines. 0 where a foot is off its face or out of order.
    """
    near = tuning[c.CUT_REACH]
    foot_p, off_p, length = foot_and_offset(graph, a, b, p)
    foot_q, off_q, _ = foot_and_offset(graph, a, b, q)
    foot_s, off_s, other_length = foot_and_offset(graph, r, u, s)
    foot_t, off_t, _ = foot_and_offset(graph, r, u, t)
    if not (0.0 < foot_p < foot_q < length and 0.0 < foot_s < foot_t < other_length):
        return 0.0
    shadow_p, _, _ = foot_and_offset(graph, r, u, p)
    shadow_q, _, _ = foot_and_offset(graph, r, u, q)
    density = reach_density(foot_q - foot_p, tuning[c.BIRTH_REACH]) / length
    density *= signed_density(off_p, near) * signed_density(off_q, near)
    density *= signed_density(foot_s - shadow_p, near) * signed_density(foot_t - shadow_q, near)
    return density * signed_density(off_s, near) * signed_density(off_t, near)


@core
def place_off_line(
    graph: Graph, proposal: Proposal, a: int, b: int, foot: float, near: float, rng: np.random.Generator
) -> int:
    """New vertex at a foot along ab, a little off the line."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    ex = graph.vertex_xy[b, 0] - ax
    ey = graph.vertex_xy[b, 1] - ay
    length = math.sqrt(ex * ex + ey * ey)
    off = signed_reach(rng, near)
    x = ax + (foot * ex - off * ey) / length
    y = ay + (foot * ey + off * ex) / length
    return place_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def place_corners(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, e: int, f: int, rng: np.random.Generator
) -> bool:
    """Place the corners p, q on e and s, t on f as new vertices 0 to 3; False if one cannot stand."""
    near = tuning[c.CUT_REACH]
    a = graph.edge_vertices[e, 0]
    b = graph.edge_vertices[e, 1]
    r = graph.edge_vertices[f, 0]
    u = graph.edge_vertices[f, 1]
    foot_p = rng.random() * graph.edge_length[e]
    foot_q = foot_p + random_reach(rng, tuning[c.BIRTH_REACH])
    if foot_q >= graph.edge_length[e]:
        return False
    p = place_off_line(graph, proposal, a, b, foot_p, near, rng)
    q = place_off_line(graph, proposal, a, b, foot_q, near, rng)
    shadow_p, _, length = foot_and_offset(graph, r, u, p)
    shadow_q, _, _ = foot_and_offset(graph, r, u, q)
    foot_s = shadow_p + signed_reach(rng, near)
    foot_t = shadow_q + signed_reach(rng, near)
    if not (0.0 < foot_s < length and 0.0 < foot_t < length):
        return False
    place_off_line(graph, proposal, r, u, foot_s, near, rng)
    place_off_line(graph, proposal, r, u, foot_t, near, rng)
    for k in range(4):
        v = proposal.new_vertices[k]
        if not is_inside(graph.window, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1]):
            return False
    return True


@core
def turn_round_gap(
    graph: Graph, proposal: Proposal, a: int, b: int, p: int, q: int, s: int, t: int, r: int, u: int
) -> None:
    """Let the loop run round the gap p, q, t, s in the wall of the faces ab and ru."""
    for vertex in (a, p, s, r, u, t, q, b):
        turn_at_vertex(graph, proposal, vertex)


@core
def propose_cut(
    graph: Graph,
    index: EdgeIndex,
    proposal: Proposal,
    tuning: np.ndarray,
    odds: np.ndarray,
    rng: np.random.Generator,
) -> tuple[bool, float]:
    """Propose to cut through the faces e, uniform, and f, uniform in N(e); the way back is added by `cut_returns`."""
    if graph.counts[c.EDGES] < 2:
        return False, 0.0
    e = pick(graph, c.EDGES, rng)
    n_e = neighbors_now(graph, index, e)
    if n_e == 0:
        return False, 0.0
    f = index.neighbors[int(rng.random() * n_e)]
    a = graph.edge_vertices[e, 0]
    b = graph.edge_vertices[e, 1]
    r = graph.edge_vertices[f, 0]
    u = graph.edge_vertices[f, 1]
    if not place_corners(graph, proposal, tuning, e, f, rng):
        return False, 0.0
    p = proposal.new_vertices[0]
    q = proposal.new_vertices[1]
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
    forward += corners_density(graph, tuning, r, u, s, t, p, q, a, b) / neighbors_now(graph, index, f)
    return forward > 0.0, -math.log(odds[c.CUT_WALL] * forward / graph.counts[c.EDGES])


@core
def block_round(grid: Grid, xy: np.ndarray) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the block of cells round the middle of the edge with ends `xy`."""
    ix = axis_index((0.5 * (xy[0] + xy[2]) - grid.x0) / grid.cell, grid.nx)
    iy = axis_index((0.5 * (xy[1] + xy[3]) - grid.y0) / grid.cell, grid.ny)
    return (
        max(ix - BLOCK_RADIUS, 0),
        min(ix + BLOCK_RADIUS, grid.nx - 1),
        max(iy - BLOCK_RADIUS, 0),
        min(iy + BLOCK_RADIUS, grid.ny - 1),
    )


@core
def list_block(index: EdgeIndex, block: tuple[int, int, int, int]) -> int:
    """List the edges of a block that carry no mark yet in ``index.neighbors``; return their number."""
    n = 0
    for iy in range(block[2], block[3] + 1):
        for ix in range(block[0], block[1] + 1):
            cell = ix + index.grid.nx * iy
            for place in range(index.cell_count[cell]):
                n = note_neighbor(index, n, index.cell_edges[cell, place])
    return n


@core
def partners_now(graph: Graph, index: EdgeIndex, edge: int) -> int:
    """List M(edge): edges through the block round its middle that share no vertex with it; return their number."""
    index.mark[0] += 1
    mark_edges_at(graph, index, graph.edge_vertices[edge, 0])
    mark_edges_at(graph, index, graph.edge_vertices[edge, 1])
    return list_block(index, block_round(index.grid, graph.edge_xy[edge]))


@core
def passes_block(grid: Grid, proposal: Proposal, k: int, block: tuple[int, int, int, int]) -> bool:
    """Whether the new edge k passes through a block."""
    for i in range(proposal.n_cells[k]):
        ix = proposal.cells[k, i] % grid.nx
        iy = proposal.cells[k, i] // grid.nx
        if block[0] <= ix <= block[1] and block[2] <= iy <= block[3]:
            return True
    return False


@core
def partners_after(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int) -> int:
    """Size of M of the new edge k in the new map."""
    block = block_round(index.grid, proposal.new_xy[k])
    begin_list_after(graph, index, proposal, k)
    n = list_block(index, block)
    for other in range(proposal.counts[N_NEW_EDGES]):
        if not share_vertex(proposal, k, other) and passes_block(index.grid, proposal, other, block):
            n += 1
    return n


@core
def share_vertex(proposal: Proposal, k: int, other: int) -> bool:
    """Whether two new edges have a vertex in common (an edge has with itself)."""
    a = proposal.new_edges[k, 0]
    b = proposal.new_edges[k, 1]
    r = proposal.new_edges[other, 0]
    u = proposal.new_edges[other, 1]
    return a == r or a == u or b == r or b == u


@core
def cut_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, odds: np.ndarray) -> float:
    """Log of odds times density with which a mend would undo the proposed cut; -inf if it could not."""
    density = 0.0
    first = block_round(index.grid, proposal.new_xy[FIRST_JAMB])
    if passes_block(index.grid, proposal, SECOND_JAMB, first):
        density += 1.0 / partners_after(graph, index, proposal, FIRST_JAMB)
    second = block_round(index.grid, proposal.new_xy[SECOND_JAMB])
    if passes_block(index.grid, proposal, FIRST_JAMB, second):
        density += 1.0 / partners_after(graph, index, proposal, SECOND_JAMB)
    if density == 0.0:
        return -math.inf
    edges_after = graph.counts[c.EDGES] + 4
    return math.log(odds[c.MEND_WALL] * 0.5 * density / edges_after)


@core
def outer_edge(graph: Graph, v: int, jamb: int) -> int:
    """The edge of the interior vertex v that is not `jamb`."""
    if graph.vertex_edges[v, 0] == jamb:
        return graph.vertex_edges[v, 1]
    return graph.vertex_edges[v, 0]


@core
def can_face(graph: Graph, a: int, b: int) -> bool:
    """Whether an edge may come between a and b."""
    return a != b and not are_adjacent(graph, a, b) and not on_one_side(graph, a, b)


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
    if edges < 6:
        return False, 0.0
    j = pick(graph, c.EDGES, rng)
    n_j = partners_now(graph, index, j)
    if n_j == 0:
        return False, 0.0
    k = index.neighbors[int(rng.random() * n_j)]
    p = graph.edge_vertices[j, 0]
    s = graph.edge_vertices[j, 1]
    q = graph.edge_vertices[k, 0]
    t = graph.edge_vertices[k, 1]
    if rng.random() < 0.5:
        q, t = t, q
    if not are_jambs(graph, p, s, q, t):
        return False, 0.0
    a = other_end(graph, outer_edge(graph, p, j), p)
    r = other_end(graph, outer_edge(graph, s, j), s)
    b = other_end(graph, outer_edge(graph, q, k), q)
    u = other_end(graph, outer_edge(graph, t, k), t)
    if not are_faces(graph, a, b, r, u, p, s, q, t):
        return False, 0.0
    for vertex in (p, q, s, t):
        drop_vertex(proposal, vertex)
    drop_edge(proposal, j)
    drop_edge(proposal, k)
    for corner in ((p, j), (q, k), (s, j), (t, k)):
        drop_edge(proposal, outer_edge(graph, corner[0], corner[1]))
    join(graph, proposal, a, b)
    join(graph, proposal, r, u)
    turn_round_gap(graph, proposal, a, b, p, q, s, t, r, u)
    forward = 1.0 / n_j
    n_k = partners_now(graph, index, k)
    if index.marks[j] == index.mark[0]:
        forward += 1.0 / n_k
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
def mend_returns(graph: Graph, index: EdgeIndex, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray) -> float:
    """Log of odds times density with which a cut would undo the proposed mend; -inf if it could not."""
    if not new_edges_share_cell(proposal):
        return -math.inf
    a = proposal.new_edges[FIRST_FACE, 0]
    b = proposal.new_edges[FIRST_FACE, 1]
    r = proposal.new_edges[SECOND_FACE, 0]
    u = proposal.new_edges[SECOND_FACE, 1]
    p = proposal.old_vertices[0]
    q = proposal.old_vertices[1]
    s = proposal.old_vertices[2]
    t = proposal.old_vertices[3]
    n_first = neighbors_after(graph, index, proposal, FIRST_FACE) + 1
    n_second = neighbors_after(graph, index, proposal, SECOND_FACE) + 1
    density = corners_density(graph, tuning, a, b, p, q, s, t, r, u) / n_first
    density += corners_density(graph, tuning, r, u, s, t, p, q, a, b) / n_second
    if density == 0.0:
        return -math.inf
    edges_after = graph.counts[c.EDGES] - 4
    return math.log(odds[c.CUT_WALL] * density / edges_after)
