"""Whether the new edges of a proposal cross an edge that remains, or one another (paper, section 1.3.3)."""

from prf.kernels._jit import core
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import segments_meet
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import N_NEW_EDGES, Proposal, find_cells_of, is_edge_removed


@core
def crosses_in_cell(graph: Graph, index: EdgeIndex, proposal: Proposal, k: int, cell: int) -> bool:
    """Whether the new edge k meets an edge of one cell that remains and has no vertex in common with it."""
    a = proposal.new_edges[k, 0]
    b = proposal.new_edges[k, 1]
    p = proposal.new_xy[k]
    for place in range(index.cell_count[cell]):
        edge = index.cell_edges[cell, place]
        q = graph.edge_xy[edge]
        if segments_meet(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]):
            u = graph.edge_vertices[edge, 0]
            v = graph.edge_vertices[edge, 1]
            if u != a and u != b and v != a and v != b and not is_edge_removed(proposal, edge):
                return True
    return False


@core
def new_edges_meet(proposal: Proposal) -> bool:
    """Whether two new edges without a common vertex meet."""
    n = proposal.counts[N_NEW_EDGES]
    for i in range(n):
        for k in range(i):
            p = proposal.new_xy[i]
            q = proposal.new_xy[k]
            if segments_meet(p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]):
                a = proposal.new_edges[i]
                b = proposal.new_edges[k]
                if a[0] != b[0] and a[0] != b[1] and a[1] != b[0] and a[1] != b[1]:
                    return True
    return False


@core
def is_valid(graph: Graph, index: EdgeIndex, proposal: Proposal) -> bool:
    """Whether the new edges cross nothing; leaves the cells of each new edge in the proposal."""
    if new_edges_meet(proposal):
        return False
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(find_cells_of(index.grid, proposal, k)):
            if crosses_in_cell(graph, index, proposal, k, proposal.cells[k, i]):
                return False
    return True
