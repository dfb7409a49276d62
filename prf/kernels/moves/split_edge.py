"""Figure 2 (d): an edge is split by a new vertex, and the reverse, the two edges of a vertex are merged into one.

Not in the paper: an edge is bent to a return by a new vertex there, and the reverse. A split has its foot on the edge.
A corner past the end of an edge, such as one return reveals, needs a vertex whose foot lies anywhere.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves.aiming import aim_at_wall, share_of_new
from prf.kernels.moves.placing import beside, beside_density, is_inside, log_or_minus_infinity
from prf.kernels.moves.square import corner_density, near_corner, square_share
from prf.kernels.state import proposal as edit
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, can_join, edges_at, ends_of, neighbors_of, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.state.targets import Targets, first_density, target_of


@core
def split_density(graph: Graph, tuning: Array, lines: Array, u: int, w: int, x: float, y: float) -> float:
    """Density g of the new vertex at (x, y) when uw is split: beside it, or near a corner along the building."""
    share = square_share(lines)
    density = beside_density(graph.vertex_xy[u], graph.vertex_xy[w], x, y, tuning[c.SPLIT_REACH])
    if share == 0.0:
        return density
    square = corner_density(lines, graph.vertex_xy[u], graph.vertex_xy[w], x, y, tuning[c.CUT_REACH])
    return (1.0 - share) * density + share * square


@core
def lead_through(graph: Graph, proposal: Proposal, edge: int) -> None:
    """Replace an edge by two between its ends and the new vertex."""
    u, w = ends_of(graph, edge)
    v = proposal.new_vertices[0]
    edit.remove_edge(proposal, edge)
    edit.add_edge(graph, proposal, u, v)
    edit.add_edge(graph, proposal, v, w)
    edit.turn_round(graph, proposal, (u, v, w))


@core
def pick_to_remove(graph: Graph, rng: Rng) -> tuple[int, int, int]:
    """A uniform interior vertex and its neighbours; NONE where there is none, or no edge may join these.

    They may be adjacent already, or lie on one side.
    """
    if graph.counts[c.INTERIOR_VERTICES] > 0:
        v = pick(graph, c.INTERIOR_VERTICES, rng)
        u, w = neighbors_of(graph, v)
        if can_join(graph, u, w):
            return v, u, w
    return c.NONE, c.NONE, c.NONE


@core
def take_out(graph: Graph, proposal: Proposal, u: int, v: int, w: int) -> None:
    """Replace the interior vertex v and its edges to u and w by the edge uw."""
    edit.remove_edges(proposal, edges_at(graph, v))
    edit.remove_vertex(proposal, v)
    edit.add_edge(graph, proposal, u, w)
    edit.turn_round(graph, proposal, (u, v, w))


@core
def propose_split(graph: Graph, proposal: Proposal, tuning: Array, lines: Array, rng: Rng) -> Densities:
    """Propose to split a uniform edge."""
    edges = graph.counts[c.EDGES]
    if edges == 0:
        return ILLEGAL
    edge = pick(graph, c.EDGES, rng)
    u, w = ends_of(graph, edge)
    if lines[c.ORIENTATION] > 0.0 and rng.random() < square_share(lines):
        x, y = near_corner(lines, graph.vertex_xy[u], graph.vertex_xy[w], tuning[c.CUT_REACH], rng)
    else:
        x, y = beside(graph.vertex_xy[u], graph.vertex_xy[w], tuning[c.SPLIT_REACH], rng)
    density = split_density(graph, tuning, lines, u, w, x, y)
    if density == 0.0 or not is_inside(graph.window, x, y):
        return ILLEGAL
    edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    lead_through(graph, proposal, edge)
    return True, math.log(density / edges), -math.log(graph.counts[c.INTERIOR_VERTICES] + 1)


@core
def propose_merge(graph: Graph, proposal: Proposal, tuning: Array, lines: Array, rng: Rng) -> Densities:
    """Propose to replace the two edges of a uniform interior vertex by one."""
    v, u, w = pick_to_remove(graph, rng)
    if v == c.NONE:
        return ILLEGAL
    density = split_density(graph, tuning, lines, u, w, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])
    if density == 0.0:
        return ILLEGAL
    take_out(graph, proposal, u, v, w)
    edges_after = graph.counts[c.EDGES] - 1
    return True, -math.log(graph.counts[c.INTERIOR_VERTICES]), math.log(density / edges_after)


@core
def propose_bend(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng
) -> Densities:
    """Propose a new vertex v, uniform in a target, in a uniform edge of E(v)."""
    v, edge, n = aim_at_wall(graph, index, targets, proposal, tuning, rng)
    if edge == c.NONE:
        return ILLEGAL
    lead_through(graph, proposal, edge)
    density = first_density(targets, tuning, target_of(targets, graph, v)) / n
    if density == 0.0:
        return ILLEGAL  # on the border of a target, but for rounding
    return True, math.log(density), -math.log(graph.counts[c.INTERIOR_VERTICES] + 1)


@core
def propose_unbend(
    graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array, rng: Rng
) -> Densities:
    """Propose to join the neighbours of a uniform interior vertex, which is removed."""
    v, u, w = pick_to_remove(graph, rng)
    if v == c.NONE:
        return ILLEGAL
    take_out(graph, proposal, u, v, w)
    log_reverse = log_reverse_of_unbend(graph, index, targets, proposal, tuning)
    return True, -math.log(graph.counts[c.INTERIOR_VERTICES]), log_reverse


@core
def log_reverse_of_unbend(graph: Graph, index: EdgeIndex, targets: Targets, proposal: Proposal, tuning: Array) -> float:
    """Log density with which a bend would undo the proposed unbending; -inf if none would."""
    edit.find_cells(index.grid, proposal)
    if tuning[c.AIMED_SHARE] == 0.0:
        return -math.inf
    v = proposal.old_vertices[0]
    density = first_density(targets, tuning, target_of(targets, graph, v))
    if density == 0.0:
        return -math.inf
    return log_or_minus_infinity(density * share_of_new(graph, index, proposal, v))
