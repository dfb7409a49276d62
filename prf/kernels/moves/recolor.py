"""Figure 2 (h), (i): two edges are exchanged for two others, which recolours a quadrilateral."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Rng, core
from prf.kernels.moves.nearby_edges import neighbors_after, neighbors_now
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, are_adjacent, ends_of, on_one_side, pick, pick_two
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal


@core
def exchange(graph: Graph, proposal: Proposal, e: int, f: int, rng: Rng) -> bool:
    """Propose one of the two ways to rejoin the ends of e and f; return whether it is legal."""
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
    edit.remove_edges(proposal, (e, f))
    edit.add_edge(graph, proposal, a, p)
    edit.add_edge(graph, proposal, b, q)
    edit.turn_round(graph, proposal, (a, b, q, p))
    return True


@core
def propose_global(graph: Graph, proposal: Proposal, rng: Rng) -> Densities:
    """(h): two distinct uniform edges (symmetric: the number of edges does not change)."""
    if graph.counts[c.EDGES] < 2:
        return ILLEGAL
    e, f = pick_two(graph, c.EDGES, rng)
    return exchange(graph, proposal, e, f, rng), 0.0, 0.0


@core
def new_edges_share_cell(proposal: Proposal) -> bool:
    """Whether the two new edges share a cell."""
    for i in range(proposal.n_cells[0]):
        for k in range(proposal.n_cells[1]):
            if proposal.cells[0, i] == proposal.cells[1, k]:
                return True
    return False


@core
def propose_local(graph: Graph, index: EdgeIndex, proposal: Proposal, rng: Rng) -> Densities:
    """(i): a uniform edge e and a uniform f in N(e).

    A pair is proposed from either of its edges: q is 1/#N(e) + 1/#N(f), but for 1 / 2 N_E, which stays.
    """
    if graph.counts[c.EDGES] < 2:
        return ILLEGAL
    e = pick(graph, c.EDGES, rng)
    n = neighbors_now(graph, index, e)
    if n == 0:
        return ILLEGAL
    f = index.neighbors[int(rng.random() * n)]
    if not exchange(graph, proposal, e, f, rng):
        return ILLEGAL
    edit.find_cells(index.grid, proposal)
    log_forward = math.log(1.0 / neighbors_now(graph, index, e) + 1.0 / neighbors_now(graph, index, f))
    return True, log_forward, log_reverse_of_recoloring(graph, index, proposal)


@core
def log_reverse_of_recoloring(graph: Graph, index: EdgeIndex, proposal: Proposal) -> float:
    """Log density with which a local recolouring would undo the proposed one; -inf if the new pair shares no cell."""
    if not new_edges_share_cell(proposal):
        return -math.inf
    first = 1.0 / (neighbors_after(graph, index, proposal, 0) + 1)
    return math.log(first + 1.0 / (neighbors_after(graph, index, proposal, 1) + 1))
