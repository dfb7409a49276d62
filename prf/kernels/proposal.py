"""A proposed change of the map: edges and vertices that go and come, and the loop whose inside is recoloured.

Every move is written in these terms, so that the crossing check, the ratio of priors, the likelihoods, the images
and the application know nothing of moves. New vertices are written into free slots of the graph, which are taken
from the stack only if the proposal is accepted. A moved vertex is one that goes and one that comes.
"""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.geometry import sine_of_angle
from prf.kernels.graph import Graph, other_end, sine_at_border

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

    counts: np.ndarray  # (N_PROPOSAL_COUNTS,) i8
    old_edges: np.ndarray  # (MOST_CHANGES,) i4 slots
    new_edges: np.ndarray  # (MOST_CHANGES, 2) i4 vertices
    new_xy: np.ndarray  # (MOST_CHANGES, 4) f8 ends of the new edges
    new_length: np.ndarray  # (MOST_CHANGES,) f8
    new_slot: np.ndarray  # (MOST_CHANGES,) i4 edge slots, known after application
    old_vertices: np.ndarray  # (MOST_CHANGES,) i4
    new_vertices: np.ndarray  # (MOST_CHANGES,) i4
    loop: np.ndarray  # (2 MOST_CHANGES, 2) f8
    affected: np.ndarray  # (4 MOST_CHANGES,) i4 vertices of the new map whose angle is new
    affected_sine: np.ndarray  # (4 MOST_CHANGES,) f8
    cells: np.ndarray  # (MOST_CHANGES, room) i4 cells of the new edges
    n_cells: np.ndarray  # (MOST_CHANGES,) i8


@core
def clear(proposal: Proposal) -> None:
    """Start an empty proposal."""
    proposal.counts[:] = 0


@core
def drop_edge(proposal: Proposal, edge: int) -> None:
    """Let an edge go."""
    n = proposal.counts[N_OLD_EDGES]
    proposal.old_edges[n] = edge
    proposal.counts[N_OLD_EDGES] = n + 1


@core
def drop_vertex(proposal: Proposal, vertex: int) -> None:
    """Let a vertex go."""
    n = proposal.counts[N_OLD_VERTICES]
    proposal.old_vertices[n] = vertex
    proposal.counts[N_OLD_VERTICES] = n + 1


@core
def place_vertex(graph: Graph, proposal: Proposal, x: float, y: float, side: int) -> int:
    """Write a new vertex into the next free slot and return the slot."""
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
def join(graph: Graph, proposal: Proposal, a: int, b: int) -> None:
    """Let an edge come between the vertices a and b."""
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
    proposal.counts[N_NEW_EDGES] = n + 1


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
def goes(proposal: Proposal, edge: int) -> bool:
    """Whether the proposal lets `edge` go."""
    for k in range(proposal.counts[N_OLD_EDGES]):
        if proposal.old_edges[k] == edge:
            return True
    return False


@core
def vertex_goes(proposal: Proposal, vertex: int) -> bool:
    """Whether the proposal lets `vertex` go."""
    for k in range(proposal.counts[N_OLD_VERTICES]):
        if proposal.old_vertices[k] == vertex:
            return True
    return False


@core
def note_affected(proposal: Proposal, vertex: int) -> None:
    """Enter a vertex of the new map into the list of those whose angle is new, once."""
    n = proposal.counts[N_AFFECTED]
    for k in range(n):
        if proposal.affected[k] == vertex:
            return
    proposal.affected[n] = vertex
    proposal.counts[N_AFFECTED] = n + 1


@core
def collect_affected(graph: Graph, proposal: Proposal) -> None:
    """List the vertices of the new map at which an edge goes or comes."""
    proposal.counts[N_AFFECTED] = 0
    for k in range(proposal.counts[N_NEW_EDGES]):
        note_affected(proposal, proposal.new_edges[k, 0])
        note_affected(proposal, proposal.new_edges[k, 1])
    for k in range(proposal.counts[N_OLD_EDGES]):
        for end in range(2):
            v = graph.edge_vertices[proposal.old_edges[k], end]
            if not vertex_goes(proposal, v):
                note_affected(proposal, v)


@core
def new_neighbors(graph: Graph, proposal: Proposal, v: int) -> tuple[int, int]:
    """Neighbours of v in the new map (the second NONE if there is but one)."""
    first = c.NONE
    second = c.NONE
    for k in range(2):
        edge = graph.vertex_edges[v, k]
        if edge != c.NONE and not goes(proposal, edge):
            second = first
            first = other_end(graph, edge, v)
    for k in range(proposal.counts[N_NEW_EDGES]):
        a = proposal.new_edges[k, 0]
        b = proposal.new_edges[k, 1]
        if a == v:
            second = first
            first = b
        elif b == v:
            second = first
            first = a
    return first, second


@core
def new_sine(graph: Graph, proposal: Proposal, v: int) -> float:
    """sin(phi_v) in the new map."""
    a, b = new_neighbors(graph, proposal, v)
    vx = graph.vertex_xy[v, 0]
    vy = graph.vertex_xy[v, 1]
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    if graph.vertex_side[v] != c.INTERIOR:
        length = math.sqrt((ax - vx) * (ax - vx) + (ay - vy) * (ay - vy))
        return sine_at_border(graph.vertex_side[v], vx, vy, ax, ay, length)
    return sine_of_angle(vx, vy, ax, ay, graph.vertex_xy[b, 0], graph.vertex_xy[b, 1])


@core
def log_prior_change(graph: Graph, proposal: Proposal, scale: float) -> float:
    """Change of log h (equations 1-3): p^|E| exp(-2 p length) prod 1/|e| prod sin(phi), from cached terms."""
    collect_affected(graph, proposal)
    ratio = 1.0
    length = 0.0
    for k in range(proposal.counts[N_OLD_EDGES]):
        old = graph.edge_length[proposal.old_edges[k]]
        ratio *= old
        length -= old
    for k in range(proposal.counts[N_NEW_EDGES]):
        ratio /= proposal.new_length[k]
        length += proposal.new_length[k]
    for k in range(proposal.counts[N_OLD_VERTICES]):
        ratio /= graph.vertex_sine[proposal.old_vertices[k]]
    for k in range(proposal.counts[N_AFFECTED]):
        v = proposal.affected[k]
        if graph.vertex_edges[v, 0] != c.NONE:
            ratio /= graph.vertex_sine[v]
        proposal.affected_sine[k] = new_sine(graph, proposal, v)
        ratio *= proposal.affected_sine[k]
    added = proposal.counts[N_NEW_EDGES] - proposal.counts[N_OLD_EDGES]
    return added * math.log(scale) - 2.0 * scale * length + math.log(ratio)


@core
def plain_prior_change(graph: Graph, proposal: Proposal, scale: float) -> float:
    """Change of |E| log p - 2 p length: the log prior as a density over the lines that carry the edges.

    Over vertices it has the factors 1/|e| and sin(phi) besides, which are the change of measure from lines. They make
    short edges dense, not probable; a mode that counted them would be a heap of splinters.
    """
    length = 0.0
    for k in range(proposal.counts[N_NEW_EDGES]):
        length += proposal.new_length[k]
    for k in range(proposal.counts[N_OLD_EDGES]):
        length -= graph.edge_length[proposal.old_edges[k]]
    added = proposal.counts[N_NEW_EDGES] - proposal.counts[N_OLD_EDGES]
    return added * math.log(scale) - 2.0 * scale * length
