"""Ground that no reading concerns, where a map follows the prior: moves there need no readings (docs/prior-ground.md).

What a reading may ever concern is closed by guards. An edge that meets none of them is live; the others are frozen,
which takes them and their vertices out of the sets that moves sample from.
"""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core, core_entry
from prf.kernels.beams import Beams, trace_beam
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.graph import Graph, classify_vertex, joins_adjacent_sides, set_add, set_remove
from prf.kernels.grid import walk
from prf.kernels.guards import Guards, meets_any


@core
def classify_all(graph: Graph) -> None:
    """Bring the sets of triangles up to date for every interior vertex."""
    for i in range(graph.counts[c.INTERIOR_VERTICES]):
        classify_vertex(graph, graph.members[c.INTERIOR_VERTICES, i])


@core_entry
def freeze(graph: Graph, index: EdgeIndex, guards: Guards, frozen: np.ndarray) -> int:
    """Take all edges but live ones, and their vertices, out of the sets; write these edges, return their number."""
    n = 0
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        xy = graph.edge_xy[edge]
        if meets_any(guards, xy, index.path, walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path), True):
            frozen[n] = edge
            n += 1
    for i in range(n):
        set_remove(graph, c.EDGES, frozen[i])
        set_remove(graph, c.CORNER_CUTS, frozen[i])
    for i in range(n):
        for end in range(2):
            v = graph.edge_vertices[frozen[i], end]
            for kind in (c.INTERIOR_VERTICES, c.BOUNDARY_VERTICES, c.TRIANGLE_VERTICES, c.BOUNDARY_APEXES):
                set_remove(graph, kind, v)
    classify_all(graph)
    return n


@core_entry
def thaw(graph: Graph, frozen: np.ndarray, n: int) -> None:
    """Put the first `n` of the `frozen` edges, and their vertices, back into the sets."""
    for i in range(n):
        edge = frozen[i]
        set_add(graph, c.EDGES, edge)
        if joins_adjacent_sides(graph, graph.edge_vertices[edge, 0], graph.edge_vertices[edge, 1]):
            set_add(graph, c.CORNER_CUTS, edge)
        for end in range(2):
            v = graph.edge_vertices[edge, end]
            set_add(graph, c.INTERIOR_VERTICES if graph.vertex_side[v] == c.INTERIOR else c.BOUNDARY_VERTICES, v)
    classify_all(graph)


@core_entry
def retrace(graph: Graph, index: EdgeIndex, beams: Beams, influence: np.ndarray) -> None:
    """Find anew where beams end that nothing stopped within their `influence` (n,); lists are not touched.

    Their likelihoods, and those of all others, stay what they were.
    """
    for beam in range(beams.ray.shape[0]):
        if beams.ray[beam, c.DISTANCE] > influence[beam]:
            trace_beam(graph, index, beams, beam)
