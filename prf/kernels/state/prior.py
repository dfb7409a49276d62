"""The Arak prior of a map, log h of equations 1-3, and its change by a proposal."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.geometry import sine_of_angle
from prf.kernels.state.graph import Graph, other_end, sine_at_border
from prf.kernels.state.lines import log_direction
from prf.kernels.state.proposal import (
    N_AFFECTED,
    N_NEW_EDGES,
    N_OLD_EDGES,
    N_OLD_VERTICES,
    Proposal,
    is_edge_removed,
    is_vertex_removed,
    new_ends,
)


@core
def log_prior(graph: Graph, scale: float, lines: Array) -> float:
    """Log h of equations 1-3 from the cached lengths and sines, with the law of directions and its normaliser."""
    total = -lines[c.LOG_NORMALISER]
    length = 0.0
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        edge_length = graph.edge_length[edge]
        total += math.log(scale / edge_length)
        length += edge_length
        if lines[c.ORIENTATION] > 0.0:
            total += log_direction(lines, scale, graph.edge_xy[edge], edge_length)
    for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES):
        for i in range(graph.counts[kind]):
            total += math.log(graph.vertex_sine[graph.members[kind, i]])
    return total - 2.0 * scale * length


@core
def add_affected(proposal: Proposal, vertex: int) -> None:
    """Enter a vertex of the new map into the list of those whose angle is new, once."""
    n = proposal.counts[N_AFFECTED]
    for k in range(n):
        if proposal.affected[k] == vertex:
            return
    proposal.affected[n] = vertex
    proposal.counts[N_AFFECTED] = n + 1


@core
def collect_affected(graph: Graph, proposal: Proposal) -> None:
    """List the vertices of the new map at which an edge is removed or added."""
    proposal.counts[N_AFFECTED] = 0
    for k in range(proposal.counts[N_NEW_EDGES]):
        add_affected(proposal, proposal.new_edges[k, 0])
        add_affected(proposal, proposal.new_edges[k, 1])
    for k in range(proposal.counts[N_OLD_EDGES]):
        for end in range(2):
            v = graph.edge_vertices[proposal.old_edges[k], end]
            if not is_vertex_removed(proposal, v):
                add_affected(proposal, v)


@core
def new_neighbors(graph: Graph, proposal: Proposal, v: int) -> tuple[int, int]:
    """Neighbours of v in the new map (the second NONE if there is but one)."""
    first = c.NONE
    second = c.NONE
    for k in range(2):
        edge = graph.vertex_edges[v, k]
        if edge != c.NONE and not is_edge_removed(proposal, edge):
            second = first
            first = other_end(graph, edge, v)
    for k in range(proposal.counts[N_NEW_EDGES]):
        a, b = new_ends(proposal, k)
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
def direction_change(graph: Graph, proposal: Proposal, scale: float, lines: Array) -> float:
    """Change of what the law of directions adds over all edges."""
    change = 0.0
    if lines[c.ORIENTATION] > 0.0:
        for k in range(proposal.counts[N_NEW_EDGES]):
            change += log_direction(lines, scale, proposal.new_xy[k], proposal.new_length[k])
        for k in range(proposal.counts[N_OLD_EDGES]):
            edge = proposal.old_edges[k]
            change -= log_direction(lines, scale, graph.edge_xy[edge], graph.edge_length[edge])
    return change


@core
def log_prior_change(graph: Graph, proposal: Proposal, scale: float, lines: Array) -> float:
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
    plain = added * math.log(scale) - 2.0 * scale * length + math.log(ratio)
    return plain + direction_change(graph, proposal, scale, lines)


@core
def log_line_prior_change(graph: Graph, proposal: Proposal, scale: float, lines: Array) -> float:
    """Change of |E| log p - 2 p length: the log prior as a density over the lines that carry the edges.

    With the law of directions it is |E| log p + sum log m(theta) - sum lambda(theta) |e|.

    Over vertices it has the factors 1/|e| and sin(phi) besides, which are the change of measure from lines. They make
    short edges dense, not probable; a mode that counted them would be a heap of splinters.
    """
    length = 0.0
    for k in range(proposal.counts[N_NEW_EDGES]):
        length += proposal.new_length[k]
    for k in range(proposal.counts[N_OLD_EDGES]):
        length -= graph.edge_length[proposal.old_edges[k]]
    added = proposal.counts[N_NEW_EDGES] - proposal.counts[N_OLD_EDGES]
    plain = added * math.log(scale) - 2.0 * scale * length
    return plain + direction_change(graph, proposal, scale, lines)
