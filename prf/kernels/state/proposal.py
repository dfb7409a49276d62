"""A proposed change of the map: edges and vertices to remove and to add, and the loop whose inside is recoloured.

Every move is written in these terms, so that the crossing check, the prior, the likelihoods, the images and the
application do not depend on moves. New vertices are written into free slots of the graph, which are taken from the
stack only if the proposal is accepted. To move a vertex is to remove it and to add another.
"""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import Grid, walk

# Entries of ``Proposal.counts``.
N_OLD_EDGES = 0
N_NEW_EDGES = 1
N_OLD_VERTICES = 2
N_NEW_VERTICES = 3
N_LOOP = 4
N_AFFECTED = 5
N_PROPOSAL_COUNTS = 6


class Proposal(NamedTuple):
    """Scratch arrays of one chain, overwritten by each proposal."""

    counts: Array  # (N_PROPOSAL_COUNTS,) i8
    old_edges: Array  # (MOST_CHANGES,) i4 slots
    new_edges: Array  # (MOST_CHANGES, 2) i4 vertices
    new_xy: Array  # (MOST_CHANGES, 4) f8 ends of the new edges
    new_length: Array  # (MOST_CHANGES,) f8
    new_slot: Array  # (MOST_CHANGES,) i4 edge slots, known after application
    old_vertices: Array  # (MOST_CHANGES,) i4
    new_vertices: Array  # (MOST_CHANGES,) i4
    loop: Array  # (2 MOST_CHANGES, 2) f8
    affected: Array  # (4 MOST_CHANGES,) i4 vertices of the new map whose angle is new
    affected_sine: Array  # (4 MOST_CHANGES,) f8
    cells: Array  # (MOST_CHANGES, room) i4 cells of the new edges
    n_cells: Array  # (MOST_CHANGES,) i8 their numbers; 0: not written yet


Densities = tuple[bool, float, float]
"""What a move returns: whether it is legal, log_forward and log_reverse (see ``moves``)."""
ILLEGAL: Densities = (False, 0.0, 0.0)


@core
def clear(proposal: Proposal) -> None:
    """Start an empty proposal."""
    proposal.counts[:] = 0


@core
def remove_edge(proposal: Proposal, edge: int) -> None:
    """Remove an edge."""
    n = proposal.counts[N_OLD_EDGES]
    proposal.old_edges[n] = edge
    proposal.counts[N_OLD_EDGES] = n + 1


@core
def remove_vertex(proposal: Proposal, vertex: int) -> None:
    """Remove a vertex."""
    n = proposal.counts[N_OLD_VERTICES]
    proposal.old_vertices[n] = vertex
    proposal.counts[N_OLD_VERTICES] = n + 1


@core
def remove_edges(proposal: Proposal, edges: tuple[int, ...]) -> None:
    """Remove edges."""
    for edge in edges:
        remove_edge(proposal, edge)


@core
def remove_vertices(proposal: Proposal, vertices: tuple[int, ...]) -> None:
    """Remove vertices."""
    for vertex in vertices:
        remove_vertex(proposal, vertex)


@core
def add_vertex(graph: Graph, proposal: Proposal, x: float, y: float, side: int) -> int:
    """Add a vertex, in the next free slot, and return the slot."""
    n = proposal.counts[N_NEW_VERTICES]
    v = graph.free_vertices[graph.counts[c.FREE_VERTICES] - 1 - n]
    graph.vertex_xy[v, 0] = x
    graph.vertex_xy[v, 1] = y
    graph.vertex_side[v] = side
    graph.vertex_edges[v, 0] = c.NONE
    graph.vertex_edges[v, 1] = c.NONE
    proposal.new_vertices[n] = v
    proposal.counts[N_NEW_VERTICES] = n + 1
    return v


@core
def add_edge(graph: Graph, proposal: Proposal, a: int, b: int) -> None:
    """Add an edge between the vertices a and b."""
    n = proposal.counts[N_NEW_EDGES]
    proposal.new_edges[n, 0] = a
    proposal.new_edges[n, 1] = b
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    bx = graph.vertex_xy[b, 0]
    by = graph.vertex_xy[b, 1]
    proposal.new_xy[n, 0] = ax
    proposal.new_xy[n, 1] = ay
    proposal.new_xy[n, 2] = bx
    proposal.new_xy[n, 3] = by
    proposal.new_length[n] = math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay))
    proposal.n_cells[n] = 0
    proposal.counts[N_NEW_EDGES] = n + 1


@core
def add_edges(graph: Graph, proposal: Proposal, ends: tuple[tuple[int, int], ...]) -> None:
    """Add an edge between each of these pairs of vertices."""
    for a, b in ends:
        add_edge(graph, proposal, a, b)


@core
def new_ends(proposal: Proposal, k: int) -> tuple[int, int]:
    """Both vertices of the new edge k."""
    return proposal.new_edges[k, 0], proposal.new_edges[k, 1]


@core
def find_cells_of(grid: Grid, proposal: Proposal, k: int) -> int:
    """Write the cells that the new edge k passes, where they are not known; return their number."""
    if proposal.n_cells[k] == 0:
        xy = proposal.new_xy[k]
        proposal.n_cells[k] = walk(grid, xy[0], xy[1], xy[2], xy[3], proposal.cells[k])
    return proposal.n_cells[k]


@core
def find_cells(grid: Grid, proposal: Proposal) -> None:
    """Write the cells that each new edge passes."""
    for k in range(proposal.counts[N_NEW_EDGES]):
        find_cells_of(grid, proposal, k)


@core
def turn_at(proposal: Proposal, x: float, y: float) -> None:
    """Add a corner to the loop."""
    n = proposal.counts[N_LOOP]
    proposal.loop[n, 0] = x
    proposal.loop[n, 1] = y
    proposal.counts[N_LOOP] = n + 1


@core
def turn_at_vertex(graph: Graph, proposal: Proposal, vertex: int) -> None:
    """Add a vertex to the loop."""
    turn_at(proposal, graph.vertex_xy[vertex, 0], graph.vertex_xy[vertex, 1])


@core
def turn_round(graph: Graph, proposal: Proposal, vertices: tuple[int, ...]) -> None:
    """Add vertices to the loop."""
    for vertex in vertices:
        turn_at_vertex(graph, proposal, vertex)


@core
def is_edge_removed(proposal: Proposal, edge: int) -> bool:
    """Whether the proposal removes `edge`."""
    for k in range(proposal.counts[N_OLD_EDGES]):
        if proposal.old_edges[k] == edge:
            return True
    return False


@core
def is_vertex_removed(proposal: Proposal, vertex: int) -> bool:
    """Whether the proposal removes `vertex`."""
    for k in range(proposal.counts[N_OLD_VERTICES]):
        if proposal.old_vertices[k] == vertex:
            return True
    return False
