"""Figure 2 (e), (f), (g), (j): a vertex moves: in the interior, along its side, past a corner; slide along an edge."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.moves.square import corner_density, near_corner, square_share
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, edges_at, neighbors_of, other_end, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal


@core
def move_interior_to(graph: Graph, proposal: Proposal, v: int, x: float, y: float) -> None:
    """Move the interior vertex v to (x, y)."""
    u, w = neighbors_of(graph, v)
    moved = edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    edit.remove_edges(proposal, edges_at(graph, v))
    edit.remove_vertex(proposal, v)
    edit.add_edge(graph, proposal, u, moved)
    edit.add_edge(graph, proposal, moved, w)
    edit.turn_round(graph, proposal, (u, v, w, moved))


@core
def landed_density(graph: Graph, tuning: Array, lines: Array, v: int, x: float, y: float, distance: float) -> float:
    """Density of a place at which the interior vertex v lands, so far from where it was."""
    u, w = neighbors_of(graph, v)
    square = corner_density(lines, graph.vertex_xy[u], graph.vertex_xy[w], x, y, tuning[c.CUT_REACH])
    share = square_share(lines)
    return (1.0 - share) * placing.near_density(distance, tuning[c.MOVE_REACH]) + share * square


@core
def propose_interior(graph: Graph, proposal: Proposal, tuning: Array, lines: Array, rng: Rng) -> Densities:
    """(e): a uniform interior vertex, displaced by a random reach in a uniform direction (symmetric).

    Where edges prefer the directions of a building some are placed near a corner along them instead.
    """
    if graph.counts[c.INTERIOR_VERTICES] == 0:
        return ILLEGAL
    v = pick(graph, c.INTERIOR_VERTICES, rng)
    if lines[c.ORIENTATION] > 0.0 and rng.random() < square_share(lines):
        u, w = neighbors_of(graph, v)
        x, y = near_corner(lines, graph.vertex_xy[u], graph.vertex_xy[w], tuning[c.CUT_REACH], rng)
    else:
        r = placing.random_reach(rng, tuning[c.MOVE_REACH])
        direction = 2.0 * math.pi * rng.random()
        x = graph.vertex_xy[v, 0] + r * math.cos(direction)
        y = graph.vertex_xy[v, 1] + r * math.sin(direction)
    if not placing.is_inside(graph.window, x, y):
        return ILLEGAL
    move_interior_to(graph, proposal, v, x, y)
    if lines[c.ORIENTATION] == 0.0:
        return True, 0.0, 0.0
    before_x = graph.vertex_xy[v, 0]
    before_y = graph.vertex_xy[v, 1]
    moved = math.hypot(x - before_x, y - before_y)
    forward = landed_density(graph, tuning, lines, v, x, y, moved)
    return True, math.log(forward), math.log(landed_density(graph, tuning, lines, v, before_x, before_y, moved))


@core
def propose_slide(graph: Graph, proposal: Proposal, rng: Rng) -> Densities:
    """(j): a uniform interior vertex v slides along one of its edges, uv, to a distance from u in [r/2, 2 r].

    The proposal is uniform in the distance r', so that the ratio of proposals is r / r'; the element of area along
    a ray from u has the Jacobian r' / r: they cancel, and both or none must be written.
    """
    if graph.counts[c.INTERIOR_VERTICES] == 0:
        return ILLEGAL
    v = pick(graph, c.INTERIOR_VERTICES, rng)
    edge = graph.vertex_edges[v, 0 if rng.random() < 0.5 else 1]
    u = other_end(graph, edge, v)
    stretch = 0.5 + 1.5 * rng.random()
    x = graph.vertex_xy[u, 0] + stretch * (graph.vertex_xy[v, 0] - graph.vertex_xy[u, 0])
    y = graph.vertex_xy[u, 1] + stretch * (graph.vertex_xy[v, 1] - graph.vertex_xy[u, 1])
    if not placing.is_inside(graph.window, x, y):
        return ILLEGAL
    move_interior_to(graph, proposal, v, x, y)
    return True, 0.0, 0.0


@core
def move_boundary_to(graph: Graph, proposal: Proposal, v: int, side: int, position: float) -> None:
    """Move the boundary vertex v to a position on `side`, its own or an adjacent one."""
    edge = graph.vertex_edges[v, 0]
    u = other_end(graph, edge, v)
    x, y = placing.side_point(graph.window, side, position)
    moved = edit.add_vertex(graph, proposal, x, y, side)
    edit.remove_edge(proposal, edge)
    edit.remove_vertex(proposal, v)
    edit.add_edge(graph, proposal, u, moved)
    edit.turn_round(graph, proposal, (u, v))
    if side != graph.vertex_side[v]:
        x, y = placing.corner_between(graph.window, graph.vertex_side[v], side)
        edit.turn_at(proposal, x, y)
    edit.turn_at_vertex(graph, proposal, moved)


@core
def propose_boundary(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """(f): a uniform boundary vertex moves on its side, anywhere or by a random reach (both symmetric)."""
    if graph.counts[c.BOUNDARY_VERTICES] == 0:
        return ILLEGAL
    v = pick(graph, c.BOUNDARY_VERTICES, rng)
    side = graph.vertex_side[v]
    if rng.random() < tuning[c.LOCAL_SHARE]:
        position = placing.position_of(graph, side, v) + placing.signed_reach(rng, tuning[c.MOVE_REACH])
        if not placing.is_on_side(graph.window, side, position):
            return ILLEGAL
    else:
        position = placing.random_position(graph.window, side, rng)
    move_boundary_to(graph, proposal, v, side, position)
    return True, 0.0, 0.0


@core
def landing_density(graph: Graph, tuning: Array, side: int, other: int, distance: float) -> float:
    """Density on `side` of a vertex that moves past the corner with `other` and lands at a distance from it."""
    local = tuning[c.LOCAL_SHARE] * placing.reach_density(distance, tuning[c.BIRTH_REACH])
    return local + (1.0 - tuning[c.LOCAL_SHARE]) / placing.side_length(graph.window, side)


@core
def propose_past_corner(graph: Graph, proposal: Proposal, tuning: Array, rng: Rng) -> Densities:
    """(g): a uniform boundary vertex moves past one of its two corners, anywhere on that side or near the corner."""
    if graph.counts[c.BOUNDARY_VERTICES] == 0:
        return ILLEGAL
    window = graph.window
    v = pick(graph, c.BOUNDARY_VERTICES, rng)
    side = graph.vertex_side[v]
    other = (side + (1 if rng.random() < 0.5 else 3)) % 4
    if rng.random() < tuning[c.LOCAL_SHARE]:
        reach = placing.random_reach(rng, tuning[c.BIRTH_REACH])
        position = placing.position_from_corner(window, other, side, reach)
        if not placing.is_on_side(window, other, position):
            return ILLEGAL
    else:
        position = placing.random_position(window, other, rng)
    u = other_end(graph, graph.vertex_edges[v, 0], v)
    if graph.vertex_side[u] == other:
        return ILLEGAL
    move_boundary_to(graph, proposal, v, other, position)
    before = placing.position_of(graph, side, v)
    forward = landing_density(graph, tuning, other, side, placing.distance_to_corner(window, other, side, position))
    backward = landing_density(graph, tuning, side, other, placing.distance_to_corner(window, side, other, before))
    return True, math.log(forward), math.log(backward)


@core
def propose_vertex_move(
    graph: Graph, proposal: Proposal, tuning: Array, lines: Array, move: int, rng: Rng
) -> Densities:
    """Fill the proposal of one of the moves above."""
    if move == c.MOVE_INTERIOR:
        return propose_interior(graph, proposal, tuning, lines, rng)
    if move == c.SLIDE:
        return propose_slide(graph, proposal, rng)
    if move == c.MOVE_BOUNDARY:
        return propose_boundary(graph, proposal, tuning, rng)
    return propose_past_corner(graph, proposal, tuning, rng)
