"""Figure 2 (h), (i): two edges are exchanged for two others, which recolours a quadrilateral."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, are_adjacent, ends_of, on_one_side, pick, pick_two
from prf.kernels.grid import walk
from prf.kernels.proposal import N_OLD_EDGES, Proposal, drop_edge, join, turn_at_vertex


@core
def exchange(graph: Graph, proposal: Proposal, e: int, f: int, rng: np.random.Generator) -> bool:
    """Propose one of the two ways to rejoin the ends of e and f; tell whether it is legal."""
    a, b = ends_of(graph, e)
    p, q = ends_of(graph, f)
    if rng.random() < 0.5:
        p, q = q, p
    if a == p or a == q or b == p or b == q:
        return False
    if are_adjacent(graph, a, p) or are_adjacent(graph, b, q):
        return False
    if on_one_side(graph, a, p) or on_one_side(graph, b, q):
        return False
    drop_edge(proposal, e)
    drop_edge(proposal, f)
    join(graph, proposal, a, p)
    join(graph, proposal, b, q)
    for vertex in (a, b, q, p):
        turn_at_vertex(graph, proposal, vertex)
    return True


@core
def propose_global(graph: Graph, proposal: Proposal, rng: np.random.Generator) -> tuple[bool, float]:
    """(h): two distinct uniform edges (symmetric: the number of edges does not change)."""
    if graph.counts[c.EDGES] < 2:
        return False, 0.0
    e, f = pick_two(graph, c.EDGES, rng)
    return exchange(graph, proposal, e, f, rng), 0.0


@core
def note_neighbor(index: EdgeIndex, n: int, edge: int) -> int:
    """Enter an edge into the list of neighbours unless it carries the mark of this list; return the new number."""
    if index.marks[edge] == index.mark[0]:
        return n
    index.marks[edge] = index.mark[0]
    index.neighbors[n] = edge
    return n + 1


@core
def mark_edges_at(graph: Graph, index: EdgeIndex, v: int) -> None:
    """Keep the edges that end in v out of the list of neighbours in work."""
    for k in range(2):
        edge = graph.vertex_edges[v, k]
        if edge != c.NONE:
            index.marks[edge] = index.mark[0]


@core
def neighbors_now(graph: Graph, index: EdgeIndex, edge: int) -> int:
    """List N(edge) in ``index.neighbors``: the edges that share a cell, but no vertex, with it; return their number."""
    xy = graph.edge_xy[edge]
    n_cells = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
    index.mark[0] += 1
    mark_edges_at(graph, index, graph.edge_vertices[edge, 0])
    mark_edges_at(graph, index, graph.edge_vertices[edge, 1])
    n = 0
    for k in range(n_cells):
        cell = index.path[k]
        for place in range(index.cell_count[cell]):
            n = note_neighbor(index, n, index.cell_edges[cell, place])
    return n


@core
def new_edges_share_cell(proposal: Proposal) -> bool:
    """Whether the two new edges share a cell."""
    for i in range(proposal.n_cells[0]):
        for k in range(proposal.n_cells[1]):
            if proposal.cells[0, i] == proposal.cells[1, k]:
                return True
    return False


@core
def begin_list_after(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int) -> None:
    """Begin a list of neighbours of the new edge k: without the edges that go and those that share a vertex with k."""
    index.mark[0] += 1
    for old in range(proposal.counts[N_OLD_EDGES]):
        index.marks[proposal.old_edges[old]] = index.mark[0]
    mark_edges_at(graph, index, proposal.new_edges[k, 0])
    mark_edges_at(graph, index, proposal.new_edges[k, 1])


@core
def neighbors_after(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int) -> int:
    """Number of edges that stay and share a cell, but no vertex, with the new edge k."""
    begin_list_after(graph, index, proposal, k)
    n = 0
    for i in range(proposal.n_cells[k]):
        cell = proposal.cells[k, i]
        for place in range(index.cell_count[cell]):
            n = note_neighbor(index, n, index.cell_edges[cell, place])
    return n


@core
def propose_local(graph: Graph, index: EdgeIndex, proposal: Proposal, rng: np.random.Generator) -> tuple[bool, float]:
    """(i): a uniform edge e and a uniform f in N(e); its ratio needs :func:`local_log_ratio` once cells are known."""
    if graph.counts[c.EDGES] < 2:
        return False, 0.0
    e = pick(graph, c.EDGES, rng)
    n = neighbors_now(graph, index, e)
    if n == 0:
        return False, 0.0
    f = index.neighbors[int(rng.random() * n)]
    return exchange(graph, proposal, e, f, rng), 0.0


@core
def local_log_ratio(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Log ratio of proposals of (i), -inf where the new pair shares no cell and the move could not return.

    A pair is proposed from either of its edges: 1/#N(e) + 1/#N(f), counted in the new map for the way back.
    """
    if not new_edges_share_cell(proposal):
        return -math.inf
    before = 1.0 / neighbors_now(graph, index, proposal.old_edges[0])
    before += 1.0 / neighbors_now(graph, index, proposal.old_edges[1])
    after = 1.0 / (neighbors_after(graph, index, proposal, 0) + 1)
    after += 1.0 / (neighbors_after(graph, index, proposal, 1) + 1)
    return math.log(after / before)
