"""Figure 2 (d): an edge is split by a new vertex, and the reverse, a vertex whose two edges merge into one."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.graph import Graph, are_adjacent, ends_of, on_one_side, other_end, pick
from prf.kernels.moves.placing import beside, beside_density, is_inside
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, place_vertex, turn_at_vertex


@core
def split_density(graph: Graph, tuning: np.ndarray, u: int, w: int, x: float, y: float) -> float:
    """Density g of the new vertex at (x, y) when the edge uw is split."""
    return beside_density(graph.vertex_xy[u], graph.vertex_xy[w], x, y, tuning[c.SPLIT_REACH])


@core
def lead_through(graph: Graph, proposal: Proposal, edge: int, v: int) -> None:
    """Let an edge go, and those between its ends and the new vertex v come."""
    u, w = ends_of(graph, edge)
    drop_edge(proposal, edge)
    join(graph, proposal, u, v)
    join(graph, proposal, v, w)
    turn_at_vertex(graph, proposal, u)
    turn_at_vertex(graph, proposal, v)
    turn_at_vertex(graph, proposal, w)


@core
def take_out(graph: Graph, proposal: Proposal, u: int, v: int, w: int) -> None:
    """Let the interior vertex v and its edges to u and w go, and the edge uw come."""
    drop_edge(proposal, graph.vertex_edges[v, 0])
    drop_edge(proposal, graph.vertex_edges[v, 1])
    drop_vertex(proposal, v)
    join(graph, proposal, u, w)
    turn_at_vertex(graph, proposal, u)
    turn_at_vertex(graph, proposal, v)
    turn_at_vertex(graph, proposal, w)


@core
def propose_split(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to split a uniform edge."""
    edges = graph.counts[c.EDGES]
    if edges == 0:
        return False, 0.0
    edge = pick(graph, c.EDGES, rng)
    u, w = ends_of(graph, edge)
    x, y = beside(graph.vertex_xy[u], graph.vertex_xy[w], tuning[c.SPLIT_REACH], rng)
    density = split_density(graph, tuning, u, w, x, y)
    if density == 0.0 or not is_inside(graph.window, x, y):
        return False, 0.0
    lead_through(graph, proposal, edge, place_vertex(graph, proposal, x, y, c.INTERIOR))
    forward = odds[c.SPLIT] * density / edges
    return True, math.log(odds[c.MERGE] / ((graph.counts[c.INTERIOR_VERTICES] + 1) * forward))


@core
def propose_merge(
    graph: Graph, proposal: Proposal, tuning: np.ndarray, odds: np.ndarray, rng: np.random.Generator
) -> tuple[bool, float]:
    """Propose to replace the two edges of a uniform interior vertex by one.

    Illegal where that would double an edge (the neighbours are adjacent) or lay one along a side.
    """
    interior = graph.counts[c.INTERIOR_VERTICES]
    if interior == 0:
        return False, 0.0
    v = pick(graph, c.INTERIOR_VERTICES, rng)
    u = other_end(graph, graph.vertex_edges[v, 0], v)
    w = other_end(graph, graph.vertex_edges[v, 1], v)
    if are_adjacent(graph, u, w) or on_one_side(graph, u, w):
        return False, 0.0
    density = split_density(graph, tuning, u, w, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])
    if density == 0.0:
        return False, 0.0
    take_out(graph, proposal, u, v, w)
    edges_after = graph.counts[c.EDGES] - 1
    backward = odds[c.SPLIT] * density / edges_after
    return True, math.log(backward * interior / odds[c.MERGE])
