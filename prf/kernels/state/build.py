"""Filling and summing of a chain's arrays from nothing: at the start, when room grows, and at fixed steps."""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.beams import relist_beams, trace_beam
from prf.kernels.readings.cones import relist_cones, sense_now
from prf.kernels.readings.points import sum_points
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex, index_edge
from prf.kernels.state.free_space import black_area
from prf.kernels.state.graph import (
    Graph,
    classify_vertex,
    distance,
    insert_edge,
    insert_vertex,
    is_drawn,
    set_remove,
    vertex_sine_now,
)
from prf.kernels.state.guards import count_blocked
from prf.kernels.walls.law import log_map_prior


@core
def is_movable(graph: Graph, v: int) -> bool:
    """Whether no edge of v is frozen, or missing here."""
    first = graph.vertex_edges[v, 0]
    if first == c.NONE or not is_drawn(graph, first):
        return False
    last = graph.vertex_edges[v, 1]
    return graph.vertex_side[v] != c.INTERIOR or (last != c.NONE and is_drawn(graph, last))


@core_entry
def fill_graph(graph: Graph, n_vertices: int, edges: Array, is_live: Array) -> None:
    """Insert the vertices of the first `n_vertices` slots and the edges (n, 2), of which only live ones can be drawn.

    A vertex can be drawn if all its edges can; a vertex beyond a part of a map may lack one.
    """
    for v in range(n_vertices):
        insert_vertex(graph, v)
    for k in range(edges.shape[0]):
        a = edges[k, 0]
        b = edges[k, 1]
        edge = insert_edge(graph, a, b, distance(graph, a, b))
        if is_live[k] == 0:
            set_remove(graph, c.EDGES, edge)
            set_remove(graph, c.CORNER_CUTS, edge)
    for v in range(n_vertices):
        if graph.vertex_side[v] != c.INTERIOR or graph.vertex_edges[v, 1] != c.NONE:
            graph.vertex_sine[v] = vertex_sine_now(graph, v)
        if not is_movable(graph, v):
            set_remove(graph, c.INTERIOR_VERTICES, v)
            set_remove(graph, c.BOUNDARY_VERTICES, v)
    for i in range(graph.counts[c.INTERIOR_VERTICES]):
        classify_vertex(graph, graph.members[c.INTERIOR_VERTICES, i])


@core_entry
def fill_index(graph: Graph, index: EdgeIndex, frozen: Array) -> bool:
    """Enter all edges, with the `frozen`, into an empty index; return False if a cell is or would be short of room."""
    has_room = True
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        if index_edge(index, edge, graph.edge_xy[edge]):
            has_room = False
    for edge in frozen:
        if index_edge(index, edge, graph.edge_xy[edge]):
            has_room = False
    return has_room


@core
def trace_readings(chain: Chain) -> None:
    """Find every beam's impact, every cone's extent, and the log likelihoods of both, from scratch."""
    for beam in range(chain.beams.ray.shape[0]):
        trace_beam(chain.graph, chain.edge_index, chain.beams, beam)
    for cone in range(chain.cones.pose.shape[0]):
        sense_now(chain.graph, chain.edge_index, chain.cones, cone, chain.proposal)


@core
def sum_and_list(chain: Chain) -> None:
    """Recompute the sums of length, log prior and log likelihood and lay out both indexes anew."""
    graph = chain.graph
    chain.edge_index.cell_count[:] = 0
    lists = chain.guards.lists
    if not fill_index(graph, chain.edge_index, lists[1 : 1 + lists[0]]):
        graph.counts[c.NEEDS_ROOM] = 1
    length = 0.0
    for i in range(graph.counts[c.EDGES]):
        length += graph.edge_length[graph.members[c.EDGES, i]]
    graph.sums[c.TOTAL_LENGTH] = length
    graph.sums[c.LOG_PRIOR] = log_map_prior(graph, chain.density, chain.lines)
    if chain.density[c.FREE_SPACE] > 0.0:
        graph.sums[c.LOG_PRIOR] -= chain.density[c.FREE_SPACE] * black_area(graph, chain.edge_index, graph)
    readings = relist_beams(chain.beams) + relist_cones(chain.cones)
    graph.sums[c.LOG_LIKELIHOOD] = readings + sum_points(chain.points)
    graph.counts[c.OCCUPIED] = chain.sensors.black.sum() + count_blocked(graph, chain.edge_index, chain.guards)


@core_entry
def recompute(chain: Chain, traces: bool, sums: bool) -> None:
    """Trace readings, make sums anew, or both: one entry, as the way of a chain from Python takes long to compile."""
    if traces:
        trace_readings(chain)
    if sums:
        sum_and_list(chain)


def trace_all(chain: Chain) -> None:
    """Find every beam's impact, every cone's extent, and the log likelihoods of both, from scratch."""
    recompute(chain, True, False)


def recompute_sums(chain: Chain) -> None:
    """Recompute the sums of length, log prior and log likelihood and lay out both indexes anew.

    Orders within the lists of cells decide which neighbour a random number picks and how sums are rounded. After
    this they follow from the graph and the impacts alone.
    """
    recompute(chain, False, True)
