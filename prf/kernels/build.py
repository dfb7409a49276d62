"""Filling and summing of a chain's arrays from nothing: at the start, when room grows, and at fixed steps."""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core_entry
from prf.kernels.beams import relist_beams, trace_beam
from prf.kernels.chain import Chain
from prf.kernels.cones import relist_cones, sense_now
from prf.kernels.edge_index import EdgeIndex, index_edge
from prf.kernels.graph import Graph, classify_vertex, distance, insert_edge, insert_vertex, vertex_sine_now
from prf.kernels.grid import Grid, cell_at
from prf.kernels.guards import count_blocked, index_frozen
from prf.kernels.points import sum_points
from prf.kernels.prior import log_prior
from prf.kernels.sites import count_occupied


@core_entry
def fill_graph(graph: Graph, n_vertices: int, edges: Array) -> None:
    """Insert the vertices of the first `n_vertices` slots, whose coordinates are set, and the given edges (n, 2)."""
    for v in range(n_vertices):
        insert_vertex(graph, v)
    for k in range(edges.shape[0]):
        a = edges[k, 0]
        b = edges[k, 1]
        insert_edge(graph, a, b, distance(graph, a, b))
    for v in range(n_vertices):
        graph.vertex_sine[v] = vertex_sine_now(graph, v)
        classify_vertex(graph, v)


@core_entry
def fill_index(graph: Graph, index: EdgeIndex) -> bool:
    """Enter all edges into an empty index; return False if a cell is, or would be, short of room."""
    has_room = True
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        if index_edge(index, edge, graph.edge_xy[edge]):
            has_room = False
    return has_room


@core_entry
def trace_all(chain: Chain) -> None:
    """Find every beam's impact, every cone's extent, and the log likelihoods of both, from scratch."""
    for beam in range(chain.beams.ray.shape[0]):
        trace_beam(chain.graph, chain.edge_index, chain.beams, beam)
    for cone in range(chain.cones.pose.shape[0]):
        sense_now(chain.graph, chain.edge_index, chain.cones, cone, chain.proposal)


@core_entry
def recompute_sums(chain: Chain) -> None:
    """Recompute the sums of length, log prior and log likelihood and lay out both indexes anew.

    Orders within the lists of cells decide which neighbour a random number picks and how sums are rounded. After
    this they follow from the graph and the impacts alone.
    """
    graph = chain.graph
    chain.edge_index.cell_count[:] = 0
    has_room = fill_index(graph, chain.edge_index)
    if not index_frozen(graph, chain.edge_index, chain.guards) or not has_room:
        graph.counts[c.NEEDS_ROOM] = 1
    length = 0.0
    for i in range(graph.counts[c.EDGES]):
        length += graph.edge_length[graph.members[c.EDGES, i]]
    graph.sums[c.TOTAL_LENGTH] = length
    graph.sums[c.LOG_PRIOR] = log_prior(graph, chain.density[c.SCALE])
    readings = relist_beams(chain.beams) + relist_cones(chain.cones)
    graph.sums[c.LOG_LIKELIHOOD] = readings + sum_points(chain.points)
    graph.counts[c.OCCUPIED] = count_occupied(chain.sensors) + count_blocked(graph, chain.edge_index, chain.guards)


@core_entry
def cells_of(grid: Grid, xy: Array, cells: Array) -> None:
    """Write the cell of each point of `xy` (n, 2)."""
    for k in range(xy.shape[0]):
        cells[k] = cell_at(grid, xy[k, 0], xy[k, 1])
