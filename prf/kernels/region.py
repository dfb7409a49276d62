"""A region in which alone a map is changed for some steps.

Edges that pass the region are live, and so are interior vertices in it; all others are frozen: out of the sets that
moves sample from. A proposal may let only live ones go, and only live ones come. What is live is a function of the map
and of the region, so that the ratios of all moves stay what they are.
"""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core, core_entry
from prf.kernels.geometry import segment_meets_box
from prf.kernels.graph import Graph, is_drawn, set_add, set_remove
from prf.kernels.prior_ground import classify_all, thaw
from prf.kernels.proposal import N_NEW_EDGES, N_NEW_VERTICES, N_OLD_EDGES, N_OLD_VERTICES, Proposal


@core
def lies_in(graph: Graph, tuning: np.ndarray, v: int) -> bool:
    """Whether a vertex lies in the region."""
    x = graph.vertex_xy[v, 0]
    y = graph.vertex_xy[v, 1]
    return tuning[c.REGION] < x < tuning[c.REGION + 2] and tuning[c.REGION + 1] < y < tuning[c.REGION + 3]


@core
def passes_region(tuning: np.ndarray, xy: np.ndarray) -> bool:
    """Whether an edge `xy` (4,) passes the region."""
    x_min = tuning[c.REGION]
    y_min = tuning[c.REGION + 1]
    return segment_meets_box(xy[0], xy[1], xy[2], xy[3], x_min, y_min, tuning[c.REGION + 2], tuning[c.REGION + 3])


@core
def leaves_region(graph: Graph, proposal: Proposal, tuning: np.ndarray) -> bool:
    """Whether a proposal changes what is frozen, or lets something come that would be."""
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
def confine(graph: Graph, tuning: np.ndarray, frozen: np.ndarray) -> int:
    """Freeze all but what is live in the region; write the frozen edges, return their number."""
    n = 0
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        if not passes_region(tuning, graph.edge_xy[edge]):
            frozen[n] = edge
            n += 1
    for i in range(n):
        set_remove(graph, c.EDGES, frozen[i])
        set_remove(graph, c.CORNER_CUTS, frozen[i])
    for kind in (c.INTERIOR_VERTICES, c.TRIANGLE_VERTICES, c.BOUNDARY_APEXES):
        for i in range(graph.counts[kind] - 1, -1, -1):
            v = graph.members[kind, i]
            if not lies_in(graph, tuning, v):
                set_remove(graph, kind, v)
    classify_all(graph)
    return n


@core_entry
def release(graph: Graph, frozen: np.ndarray, n: int) -> None:
    """Let the first `n` of the `frozen` edges, and all interior vertices, be drawn again."""
    thaw(graph, frozen, n)
    for i in range(graph.counts[c.EDGES]):
        edge = graph.members[c.EDGES, i]
        for end in range(2):
            v = graph.edge_vertices[edge, end]
            if graph.vertex_side[v] == c.INTERIOR:
                set_add(graph, c.INTERIOR_VERTICES, v)
    classify_all(graph)
