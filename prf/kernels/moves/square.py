"""Not in the paper: proposals along the two directions of the building, and boxes, which are born and die at once.

Where edges prefer these directions (:mod:`prf.model.orientation`) a corner between two others most often lies where
one edge along each direction leads from both, and small things are boxes: by a triangle and a split they would have to
pass a map whose longest edge runs across.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.moves import placing
from prf.kernels.state import proposal as edit
from prf.kernels.state.graph import Graph, beyond, edges_at, is_removable, neighbors_of, pick
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.state.targets import Targets, first_density, pick_target, point_in, target_of

SQUARE_SHARE = 0.3
"""Share of the new corners that are proposed where edges along the building would meet, if edges prefer to be so."""


@core
def square_share(lines: Array) -> float:
    """Share of new corners that are proposed so."""
    return SQUARE_SHARE if lines[c.ORIENTATION] > 0.0 else 0.0


@core
def square_corner(lines: Array, u: Array, w: Array, which: int) -> tuple[float, float]:
    """Where an edge along the building from u meets one across it from w (2,), or the other way round."""
    cosine = math.cos(lines[c.ANGLE])
    sine = math.sin(lines[c.ANGLE])
    along = (w[0] - u[0]) * cosine + (w[1] - u[1]) * sine
    if which == 0:
        return u[0] + along * cosine, u[1] + along * sine
    return w[0] - along * cosine, w[1] - along * sine


@core
def near_corner(lines: Array, u: Array, w: Array, median: float, rng: Rng) -> tuple[float, float]:
    """Point at a :func:`random_reach` from one of the two such corners between u and w (2,)."""
    x, y = square_corner(lines, u, w, 0 if rng.random() < 0.5 else 1)
    r = placing.random_reach(rng, median)
    direction = 2.0 * math.pi * rng.random()
    return x + r * math.cos(direction), y + r * math.sin(direction)


@core
def corner_density(lines: Array, u: Array, w: Array, x: float, y: float, median: float) -> float:
    """Density in the plane with which :func:`near_corner` gives (x, y)."""
    density = 0.0
    for which in range(2):
        at_x, at_y = square_corner(lines, u, w, which)
        density += 0.5 * placing.near_density(math.hypot(x - at_x, y - at_y), median)
    return density


@core
def shifted(lines: Array, x: float, y: float, along: float, across: float) -> tuple[float, float]:
    """Point at these distances from another, in the directions of the building."""
    cosine = math.cos(lines[c.ANGLE])
    sine = math.sin(lines[c.ANGLE])
    return x + along * cosine - across * sine, y + along * sine + across * cosine


@core
def from_to(graph: Graph, lines: Array, u: int, v: int) -> tuple[float, float]:
    """How far v lies from u along and across the building."""
    cosine = math.cos(lines[c.ANGLE])
    sine = math.sin(lines[c.ANGLE])
    dx = graph.vertex_xy[v, 0] - graph.vertex_xy[u, 0]
    dy = graph.vertex_xy[v, 1] - graph.vertex_xy[u, 1]
    return dx * cosine + dy * sine, dy * cosine - dx * sine


@core
def sides_density(graph: Graph, lines: Array, tuning: Array, median: float, u: int, v: int, w: int, t: int) -> float:
    """Density of the corners v along the building from u, t across it, and w opposite."""
    near = tuning[c.CUT_REACH]
    v_along, v_across = from_to(graph, lines, u, v)
    t_along, t_across = from_to(graph, lines, u, t)
    w_along, w_across = from_to(graph, lines, u, w)
    sides = placing.signed_density(v_along, median) * placing.signed_density(t_across, median)
    off = placing.signed_density(v_across, near) * placing.signed_density(t_along, near)
    off *= placing.signed_density(w_along - v_along - t_along, near)
    return sides * off * placing.signed_density(w_across - v_across - t_across, near)


@core
def box_density(
    graph: Graph, targets: Targets, tuning: Array, lines: Array, corners: tuple[int, int, int, int]
) -> float:
    """Density with which a birth proposes the unordered box of these corners, in their order round it."""
    surface = placing.area(graph.window)
    density = 0.0
    for k in range(4):
        u, v, w, t = corners[k], corners[(k + 1) % 4], corners[(k + 2) % 4], corners[(k + 3) % 4]
        first = (1.0 - tuning[c.AIMED_SHARE]) / surface
        if tuning[c.AIMED_SHARE] > 0.0:
            first += tuning[c.AIMED_SHARE] * first_density(targets, tuning, target_of(targets, graph, u))
        if first > 0.0:
            for size in range(placing.N_SIZES):
                median = placing.reach_of(tuning, size)
                sides = sides_density(graph, lines, tuning, median, u, v, w, t)
                sides += sides_density(graph, lines, tuning, median, u, t, w, v)
                density += first * sides / placing.N_SIZES
    return density


@core
def draw_box(
    graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, lines: Array, rng: Rng
) -> tuple[int, int, int, int]:
    """One corner in a target or anywhere, a side from it along the building and one across, and the corner opposite."""
    median = placing.reach_of(tuning, int(rng.random() * placing.N_SIZES))
    near = tuning[c.CUT_REACH]
    if tuning[c.AIMED_SHARE] > 0.0 and rng.random() < tuning[c.AIMED_SHARE]:
        x, y = point_in(targets, pick_target(targets, tuning, rng), rng)
        u = edit.add_vertex(graph, proposal, x, y, c.INTERIOR)
    else:
        u = placing.uniform_vertex(graph, proposal, rng)
        x, y = graph.vertex_xy[u, 0], graph.vertex_xy[u, 1]
    along, v_across = placing.signed_reach(rng, median), placing.signed_reach(rng, near)
    across, t_along = placing.signed_reach(rng, median), placing.signed_reach(rng, near)
    vx, vy = shifted(lines, x, y, along, v_across)
    tx, ty = shifted(lines, x, y, t_along, across)
    w_along = along + t_along + placing.signed_reach(rng, near)
    wx, wy = shifted(lines, x, y, w_along, across + v_across + placing.signed_reach(rng, near))
    v = edit.add_vertex(graph, proposal, vx, vy, c.INTERIOR)
    w = edit.add_vertex(graph, proposal, wx, wy, c.INTERIOR)
    return u, v, w, edit.add_vertex(graph, proposal, tx, ty, c.INTERIOR)


@core
def propose_birth(
    graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, lines: Array, rng: Rng
) -> Densities:
    """Propose a box along the directions of the building, its corners a little off those of a rectangle."""
    corners = draw_box(graph, targets, proposal, tuning, lines, rng)
    for vertex in corners:
        if not placing.is_in_window(graph, vertex):
            return ILLEGAL
    u, v, w, t = corners
    edit.turn_round(graph, proposal, corners)
    edit.add_edges(graph, proposal, ((u, v), (v, w), (w, t), (t, u)))
    density = box_density(graph, targets, tuning, lines, corners)
    if density == 0.0:
        return ILLEGAL  # on the border of a target, but for rounding
    return True, math.log(density), math.log(4.0 / (graph.counts[c.INTERIOR_VERTICES] + 4))


@core
def propose_death(
    graph: Graph, targets: Targets, proposal: Proposal, tuning: Array, lines: Array, rng: Rng
) -> Densities:
    """Propose to remove the closed loop of a uniform interior vertex, if it has four edges."""
    n = graph.counts[c.INTERIOR_VERTICES]
    if n < 4:
        return ILLEGAL
    u = pick(graph, c.INTERIOR_VERTICES, rng)
    v, t = neighbors_of(graph, u)
    if not (is_removable(graph, v) and is_removable(graph, t)):
        return ILLEGAL
    first, last = edges_at(graph, u)
    after_v, w = beyond(graph, v, first)
    after_t, other = beyond(graph, t, last)
    if w != other or w == t or w == u or not is_removable(graph, w):
        return ILLEGAL
    edit.remove_edges(proposal, (first, last, after_v, after_t))
    edit.remove_vertices(proposal, (u, v, w, t))
    edit.turn_round(graph, proposal, (u, v, w, t))
    density = box_density(graph, targets, tuning, lines, (u, v, w, t))
    return True, math.log(4.0 / n), placing.log_or_minus_infinity(density)
