"""The gap that a cut makes in a wall and a mend closes: its corners and their density, and the edges round it."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, are_adjacent, on_one_side, other_end, pick
from prf.kernels.grid import Grid, axis_index
from prf.kernels.moves.placing import is_inside, random_reach, reach_density
from prf.kernels.moves.recolor import begin_list_after, mark_edges_at, note_neighbor
from prf.kernels.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal, place_vertex, turn_at_vertex

MEND_RADIUS = 3
"""A jamb's partner is sought in a square of cells that reaches this many cells to each side of its middle."""
CUT_RADIUS = 1
"""The other face of a wall is sought in such a square round the middle of the cut."""


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
def beyond(graph: Graph, v: int, edge: int) -> tuple[int, int]:
    """The other edge of an interior vertex v of `edge`, and the vertex at its far end."""
    other = outer_edge(graph, v, edge)
    return other, other_end(graph, other, v)


@core
def place_two(
    graph: Graph,
    proposal: Proposal,
    a: int,
    b: int,
    foot_s: float,
    foot_t: float,
    length: float,
    near: float,
    rng: np.random.Generator,
) -> bool:
    """Place two new vertices off the line ab, a little off two feet on the edge; False if one cannot stand."""
    if not (0.0 < foot_s < length and 0.0 < foot_t < length):
        return False
    s = place_off_line(graph, proposal, a, b, foot_s, near, rng)
    t = place_off_line(graph, proposal, a, b, foot_t, near, rng)
    return is_in_window(graph, s) and is_in_window(graph, t)


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

    The foot of q lies a reach further than that of p; those of s and t lie near the feet of p and q on the line ru; all
    four lie a little off their lines. 0 where a foot is off its face or out of order. The foot of p is uniform on ab,
    which is left out: faces are chosen in proportion to their lengths, so that it is uniform on all edges together.
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
    density = reach_density(foot_q - foot_p, tuning[c.BIRTH_REACH])
    density *= signed_density(off_p, near) * signed_density(off_q, near)
    density *= signed_density(foot_s - shadow_p, near) * signed_density(foot_t - shadow_q, near)
    return density * signed_density(off_s, near) * signed_density(off_t, near)


@core
def turn_round_gap(
    graph: Graph, proposal: Proposal, a: int, b: int, p: int, q: int, s: int, t: int, r: int, u: int
) -> None:
    """Let the loop run round the gap p, q, t, s in the wall of the faces ab and ru."""
    for vertex in (a, p, s, r, u, t, q, b):
        turn_at_vertex(graph, proposal, vertex)


@core
def block_at(grid: Grid, x: float, y: float, radius: int) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the block of cells round that of a point."""
    ix = axis_index((x - grid.x0) / grid.cell, grid.nx)
    iy = axis_index((y - grid.y0) / grid.cell, grid.ny)
    return max(ix - radius, 0), min(ix + radius, grid.nx - 1), max(iy - radius, 0), min(iy + radius, grid.ny - 1)


@core
def block_round(grid: Grid, xy: np.ndarray) -> tuple[int, int, int, int]:
    """Block of cells round the middle of the jamb with ends `xy` (4,)."""
    return block_at(grid, 0.5 * (xy[0] + xy[2]), 0.5 * (xy[1] + xy[3]), MEND_RADIUS)


@core
def block_round_cut(graph: Graph, grid: Grid, a: int, b: int, p: int, q: int) -> tuple[int, int, int, int]:
    """Block of cells round the middle of the cut from p to q in the face ab."""
    foot_p, _, length = foot_and_offset(graph, a, b, p)
    foot_q, _, _ = foot_and_offset(graph, a, b, q)
    share = 0.5 * (foot_p + foot_q) / length
    x = graph.vertex_xy[a, 0] + share * (graph.vertex_xy[b, 0] - graph.vertex_xy[a, 0])
    y = graph.vertex_xy[a, 1] + share * (graph.vertex_xy[b, 1] - graph.vertex_xy[a, 1])
    return block_at(grid, x, y, CUT_RADIUS)


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
def opposite_now(graph: Graph, index: EdgeIndex, edge: int, block: tuple[int, int, int, int]) -> int:
    """List the edges through a block that share no vertex with `edge`; return their number."""
    index.mark[0] += 1
    mark_edges_at(graph, index, graph.edge_vertices[edge, 0])
    mark_edges_at(graph, index, graph.edge_vertices[edge, 1])
    return list_block(index, block)


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
def share_vertex(proposal: Proposal, k: int, other: int) -> bool:
    """Whether two new edges have a vertex in common (an edge has with itself)."""
    a = proposal.new_edges[k, 0]
    b = proposal.new_edges[k, 1]
    r = proposal.new_edges[other, 0]
    u = proposal.new_edges[other, 1]
    return a == r or a == u or b == r or b == u


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
def place_at_offset(graph: Graph, proposal: Proposal, a: int, b: int, foot: float, off: float) -> int:
    """New vertex at a foot along ab and an offset from the line."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    ex = graph.vertex_xy[b, 0] - ax
    ey = graph.vertex_xy[b, 1] - ay
    length = math.sqrt(ex * ex + ey * ey)
    x = ax + (foot * ex - off * ey) / length
    y = ay + (foot * ey + off * ex) / length
    return place_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def place_off_line(
    graph: Graph, proposal: Proposal, a: int, b: int, foot: float, near: float, rng: np.random.Generator
) -> int:
    """New vertex at a foot along ab, a little off the line."""
    return place_at_offset(graph, proposal, a, b, foot, signed_reach(rng, near))


@core
def is_in_window(graph: Graph, v: int) -> bool:
    """Whether a vertex lies strictly inside the window."""
    return is_inside(graph.window, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])


@core
def partners_now(graph: Graph, index: EdgeIndex, edge: int) -> int:
    """List M(edge): edges through the block round its middle that share no vertex with it; return their number."""
    return opposite_now(graph, index, edge, block_round(index.grid, graph.edge_xy[edge]))


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
def pick_pair(graph: Graph, index: EdgeIndex, fewest: int, rng: np.random.Generator) -> tuple[int, int, int]:
    """A uniform edge, a uniform one of its M, and the size of M; (NONE, NONE, 0) with fewer edges or an empty M."""
    if graph.counts[c.EDGES] < fewest:
        return c.NONE, c.NONE, 0
    edge = pick(graph, c.EDGES, rng)
    n = partners_now(graph, index, edge)
    if n == 0:
        return c.NONE, c.NONE, 0
    return edge, index.neighbors[int(rng.random() * n)], n


@core
def links_now(graph: Graph, index: EdgeIndex, j: int, k: int) -> float:
    """1/#M(j) if k is in M(j)."""
    n = partners_now(graph, index, j)
    return 1.0 / n if index.marks[k] == index.mark[0] else 0.0


@core
def links_after(graph: Graph, index: EdgeIndex, proposal: Proposal, j: int, k: int) -> float:
    """1/#M(j) if k is in M(j), in the new map."""
    if not passes_block(index.grid, proposal, k, block_round(index.grid, proposal.new_xy[j])):
        return 0.0
    return 1.0 / partners_after(graph, index, proposal, j)


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
