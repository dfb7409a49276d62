"""Parts of a map in which alone it is changed: ground that no reading concerns, or a region for some steps.

Edges outside are frozen: out of the sets that moves sample from. What is live is a function of the map and of the part,
so that the ratios of all moves stay the same. In ground that no reading concerns the map follows
the prior, and moves need no readings: what a reading may ever concern is closed by guards, and an edge that meets none
of them is live. In a region live are the edges that pass it and the interior vertices in it.
"""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.beams import Beams, trace_beam
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import segment_meets_box
from prf.kernels.state.graph import (
    Graph,
    classify_vertex,
    ends_of,
    is_drawn,
    joins_adjacent_sides,
    set_add,
    set_remove,
)
from prf.kernels.state.grid import walk
from prf.kernels.state.guards import Guards, meets_any
from prf.kernels.state.proposal import N_NEW_EDGES, N_NEW_VERTICES, N_OLD_EDGES, N_OLD_VERTICES, Proposal


@core
def classify_all(graph: Graph) -> None:
    """Bring the sets of triangles up to date for every interior vertex."""
    for i in range(graph.counts[c.INTERIOR_VERTICES]):
        classify_vertex(graph, graph.members[c.INTERIOR_VERTICES, i])


@core
def remove_from_sets(graph: Graph, edges: Array, n: int) -> None:
    """Take the first `n` of some edges out of the sets that moves sample from."""
    for i in range(n):
        set_remove(graph, c.EDGES, edges[i])
        set_remove(graph, c.CORNER_CUTS, edges[i])


@core_entry
def freeze(graph: Graph, index: EdgeIndex, guards: Guards, frozen: Array) -> int:
    """Take all edges but live ones, and their vertices, out of the sets; write these edges, return their number."""
    n = 0
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        xy = graph.edge_xy[edge]
        if meets_any(guards, xy, index.path, walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path), True):
            frozen[n] = edge
            n += 1
    remove_from_sets(graph, frozen, n)
    for i in range(n):
        for v in ends_of(graph, frozen[i]):
            for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES, c.TRIANGLE_VERTICES, c.BOUNDARY_APEXES):
                set_remove(graph, kind, v)
    classify_all(graph)
    return n


@core_entry
def thaw(graph: Graph, frozen: Array, n: int) -> None:
    """Put the first `n` of the `frozen` edges, and their vertices, back into the sets."""
    for i in range(n):
        edge = frozen[i]
        set_add(graph, c.EDGES, edge)
        a, b = ends_of(graph, edge)
        if joins_adjacent_sides(graph, a, b):
            set_add(graph, c.CORNER_CUTS, edge)
        for v in (a, b):
            set_add(graph, c.INTERIOR_VERTICES if graph.vertex_side[v] == c.INTERIOR else c.BOUNDARY_VERTICES, v)
    classify_all(graph)


@core_entry
def retrace(graph: Graph, index: EdgeIndex, beams: Beams, influence: Array) -> None:
    """Find anew where beams end that nothing stopped within their `influence` (n,); lists are not touched.

    Their likelihoods, and those of all others, stay what they were.
    """
    for beam in range(beams.ray.shape[0]):
        if beams.ray[beam, c.DISTANCE] > influence[beam]:
            trace_beam(graph, index, beams, beam)


@core
def lies_in(graph: Graph, tuning: Array, v: int) -> bool:
    """Whether a vertex lies in the region."""
    x = graph.vertex_xy[v, 0]
    y = graph.vertex_xy[v, 1]
    return tuning[c.REGION] < x < tuning[c.REGION + 2] and tuning[c.REGION + 1] < y < tuning[c.REGION + 3]


@core
def passes_region(tuning: Array, xy: Array) -> bool:
    """Whether an edge `xy` (4,) passes the region."""
    x_min = tuning[c.REGION]
    y_min = tuning[c.REGION + 1]
    return segment_meets_box(xy[0], xy[1], xy[2], xy[3], x_min, y_min, tuning[c.REGION + 2], tuning[c.REGION + 3])


@core
def leaves_region(graph: Graph, proposal: Proposal, tuning: Array) -> bool:
    """Whether a proposal removes what is frozen, or adds what would be."""
    for k in range(proposal.counts[N_OLD_EDGES]):
        if not is_drawn(graph, proposal.old_edges[k]):
            return True
    for k in range(proposal.counts[N_OLD_VERTICES]):
        if not lies_in(graph, tuning, proposal.old_vertices[k]):
            return True
    for k in range(proposal.counts[N_NEW_VERTICES]):
        if not lies_in(graph, tuning, proposal.new_vertices[k]):
            return True
    for k in range(proposal.counts[N_NEW_EDGES]):
        if not passes_region(tuning, proposal.new_xy[k]):
            return True
    return False


@core_entry
def confine(graph: Graph, tuning: Array, frozen: Array) -> int:
    """Freeze all but what is live in the region; write the frozen edges, return their number."""
    n = 0
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        if not passes_region(tuning, graph.edge_xy[edge]):
            frozen[n] = edge
            n += 1
    remove_from_sets(graph, frozen, n)
    for kind in (c.INTERIOR_VERTICES, c.TRIANGLE_VERTICES, c.BOUNDARY_APEXES):
        for i in range(graph.counts[kind] - 1, -1, -1):
            v = graph.members[kind, i]
            if not lies_in(graph, tuning, v):
                set_remove(graph, kind, v)
    classify_all(graph)
    return n


@core_entry
def release(graph: Graph, frozen: Array, n: int) -> None:
    """Put the first `n` of the `frozen` edges, and all interior vertices, back into the sets."""
    thaw(graph, frozen, n)
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        for v in ends_of(graph, edge):
            if graph.vertex_side[v] == c.INTERIOR:
                set_add(graph, c.INTERIOR_VERTICES, v)
    classify_all(graph)
