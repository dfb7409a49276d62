"""Lists of edges near an edge or a point, by the cells of the edge index: of the present map and of the proposed one.

What a move picks from such a list its reverse must find in the list of the proposed map. `*_after` counts that, from
the index, without the edges that the proposal removes and with those that it adds.
"""

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, pick
from prf.kernels.state.grid import Grid, axis_index, walk
from prf.kernels.state.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal, new_ends

Block = tuple[int, int, int, int]
"""First and last column, first and last row of cells."""
MEND_RADIUS = 3
"""The partner of an edge is searched in a square of cells that reaches this many cells to each side of its middle."""


@core
def note_neighbor(index: EdgeIndex, n: int, edge: int) -> int:
    """Enter an edge into the list of neighbours unless it carries the mark of this list; return the new number."""
    if index.marks[edge] == index.mark[0]:
        return n
    index.marks[edge] = index.mark[0]
    index.neighbors[n] = edge
    return n + 1


@core
def list_cells(index: EdgeIndex, cells: Array, n_cells: int) -> int:
    """List the edges of the first `n_cells` cells without this mark in ``index.neighbors``; return their number."""
    n = 0
    for i in range(n_cells):
        for place in range(index.cell_count[cells[i]]):
            n = note_neighbor(index, n, index.cell_edges[cells[i], place])
    return n


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
    return list_cells(index, index.path, n_cells)


@core
def begin_list_after(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int) -> None:
    """Begin a list of neighbours of the new edge k (or NONE): without removed edges and those that end where k does."""
    index.mark[0] += 1
    for old in range(proposal.counts[N_OLD_EDGES]):
        index.marks[proposal.old_edges[old]] = index.mark[0]
    if k != c.NONE:
        mark_edges_at(graph, index, proposal.new_edges[k, 0])
        mark_edges_at(graph, index, proposal.new_edges[k, 1])


@core
def neighbors_after(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int) -> int:
    """Number of edges that stay and share a cell, but no vertex, with the new edge k."""
    begin_list_after(graph, index, proposal, k)
    return list_cells(index, proposal.cells[k], proposal.n_cells[k])


@core
def block_at(grid: Grid, x: float, y: float, radius: int) -> Block:
    """Block of cells round that of a point."""
    ix = axis_index((x - grid.x0) / grid.cell, grid.nx)
    iy = axis_index((y - grid.y0) / grid.cell, grid.ny)
    return max(ix - radius, 0), min(ix + radius, grid.nx - 1), max(iy - radius, 0), min(iy + radius, grid.ny - 1)


@core
def block_round(grid: Grid, xy: Array) -> Block:
    """Block of cells round the middle of the jamb with ends `xy` (4,)."""
    return block_at(grid, 0.5 * (xy[0] + xy[2]), 0.5 * (xy[1] + xy[3]), MEND_RADIUS)


@core
def list_block(index: EdgeIndex, block: Block) -> int:
    """List the edges of a block without this mark in ``index.neighbors``; return their number."""
    n = 0
    for iy in range(block[2], block[3] + 1):
        for ix in range(block[0], block[1] + 1):
            cell = ix + index.grid.nx * iy
            for place in range(index.cell_count[cell]):
                n = note_neighbor(index, n, index.cell_edges[cell, place])
    return n


@core
def list_near(graph: Graph, index: EdgeIndex, block: Block, edge: int) -> int:
    """List the edges through a block that share no vertex with `edge` (NONE: all of them); return their number."""
    index.mark[0] += 1
    if edge != c.NONE:
        mark_edges_at(graph, index, graph.edge_vertices[edge, 0])
        mark_edges_at(graph, index, graph.edge_vertices[edge, 1])
    return list_block(index, block)


@core
def passes_block(grid: Grid, proposal: Proposal, k: int, block: Block) -> bool:
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
    (a, b), (r, u) = new_ends(proposal, k), new_ends(proposal, other)
    return a == r or a == u or b == r or b == u


@core
def count_near_after(graph: Graph, index: EdgeIndex, proposal: Proposal, block: Block, j: int, k: int) -> int:
    """Number of edges in the new map through a block that share no vertex with the new edge j (NONE: all of them).

    0 unless the new edge k is one of them.
    """
    if not passes_block(index.grid, proposal, k, block):
        return 0
    begin_list_after(graph, index, proposal, j)
    n = list_block(index, block)
    for new in range(proposal.counts[N_NEW_EDGES]):
        if (j == c.NONE or not share_vertex(proposal, j, new)) and passes_block(index.grid, proposal, new, block):
            n += 1
    return n


@core
def share_after(graph: Graph, index: EdgeIndex, proposal: Proposal, block: Block, j: int, k: int) -> float:
    """One over this number, 0 unless k is among them."""
    n = count_near_after(graph, index, proposal, block, j, k)
    return 1.0 / n if n > 0 else 0.0


@core
def partners_now(graph: Graph, index: EdgeIndex, edge: int) -> int:
    """List M(edge): edges through the block round its middle that share no vertex with it; return their number."""
    return list_near(graph, index, block_round(index.grid, graph.edge_xy[edge]), edge)


@core
def pick_pair(graph: Graph, index: EdgeIndex, fewest: int, rng: Rng) -> tuple[int, int, int]:
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
    return share_after(graph, index, proposal, block_round(index.grid, proposal.new_xy[j]), j, k)
