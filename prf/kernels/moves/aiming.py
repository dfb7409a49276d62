"""Walls aimed at through returns: a vertex is placed where a reading ends, and an edge near it is picked."""

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.moves.nearby_edges import Block, block_at, list_near, share_after
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import Proposal
from prf.kernels.state.targets import Targets, pick_target, point_in

WALL_RADIUS = 2
"""The wall is searched in a square of cells that reaches so many to each side of the aimed vertex."""


@core
def walls_now(graph: Graph, index: EdgeIndex, v: int) -> int:
    """List E(v), the edges through the block of cells round v; return their number."""
    return list_near(graph, index, block_of(graph, index, v), c.NONE)


@core
def block_of(graph: Graph, index: EdgeIndex, v: int) -> Block:
    """Block of cells round v."""
    return block_at(index.grid, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1], WALL_RADIUS)


@core
def aim_at_wall(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng
) -> tuple[int, int, int]:
    """Place a new vertex v in a target that is picked; return it, a uniform edge of E(v), and the size of E(v).

    The edge is NONE where there is none, nothing is aimed, or v lies outside the window.
    """
    if graph.counts[c.EDGES] == 0 or tuning[c.AIMED_SHARE] == 0.0:
        return c.NONE, c.NONE, 0
    x, y = point_in(targets, pick_target(targets, tuning, rng), rng)
    v = edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    n = walls_now(graph, index, v)
    if n == 0 or not placing.is_in_window(graph, v):
        return v, c.NONE, 0
    return v, index.neighbors[int(rng.random() * n)], n


@core
def share_now(graph: Graph, index: EdgeIndex, e: int, v: int) -> float:
    """1/#E(v) if the edge e is in E(v)."""
    n = walls_now(graph, index, v)
    return 1.0 / n if index.marks[e] == index.mark[0] else 0.0


@core
def share_of_new(graph: Graph, index: EdgeIndex, proposal: Proposal, v: int) -> float:
    """1/#E(v) in the new map if its one new edge is in E(v)."""
    return share_after(graph, index, proposal, block_of(graph, index, v), c.NONE, 0)
