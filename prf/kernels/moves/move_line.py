"""Not in the paper: the line of an edge moves, shifted along its normal or turned; its neighbours keep their lines.

A wall so moves with both its corners. By moves of one vertex it would have to turn a little each time, against the
readings along it.
"""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.geometry import sine_of_angle
from prf.kernels.graph import Graph, distance, ends_of, may_go, pick
from prf.kernels.moves.gap import beyond, signed_reach
from prf.kernels.moves.placing import is_inside, reach_density
from prf.kernels.proposal import Proposal, drop_edge, drop_vertex, join, place_vertex, turn_at_vertex

STEEPEST = 1.5
"""No line is turned by more, radians: a right angle would be no turn in one direction rather than the other."""


@core
def draw_line(
    graph: Graph, tuning: np.ndarray, u: int, v: int, rng: np.random.Generator
) -> tuple[float, float, float, float, float]:
    """A point and the direction of the line of uv after a shift or a turn (1/2 each), and the angle of the turn.

    The point of a turn is its pivot, uniform on uv; the ends of an edge that turns about its middle move by a reach.
    """
    x = graph.vertex_xy[u, 0]
    y = graph.vertex_xy[u, 1]
    length = distance(graph, u, v)
    tx = (graph.vertex_xy[v, 0] - x) / length
    ty = (graph.vertex_xy[v, 1] - y) / length
    is_turn = rng.random() < 0.5
    off = signed_reach(rng, tuning[c.LINE_REACH])
    if not is_turn:
        return x - off * ty, y + off * tx, tx, ty, 0.0
    foot = rng.random() * length
    angle = 2.0 * off / length
    cosine = math.cos(angle)
    sine = math.sin(angle)
    return x + foot * tx, y + foot * ty, cosine * tx - sine * ty, sine * tx + cosine * ty, angle


@core
def place_on_ray(graph: Graph, proposal: Proposal, a: int, u: int, x: float, y: float, tx: float, ty: float) -> int:
    """New vertex where the ray from a through u meets the line through (x, y) along (tx, ty); NONE if it does not."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    dx = graph.vertex_xy[u, 0] - ax
    dy = graph.vertex_xy[u, 1] - ay
    stretch = ((y - ay) * tx - (x - ax) * ty) / (dy * tx - dx * ty)
    if not 0.0 < stretch < math.inf or not is_inside(graph.window, ax + stretch * dx, ay + stretch * dy):
        return c.NONE
    return place_vertex(graph, proposal, ax + stretch * dx, ay + stretch * dy, c.INTERIOR)


@core
def corner_sine(graph: Graph, v: int, a: int, b: int) -> float:
    """Sine of the angle at v between a and b."""
    xy = graph.vertex_xy
    return sine_of_angle(xy[v, 0], xy[v, 1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1])


@core
def measure_of_line(graph: Graph, a: int, u: int, v: int, b: int) -> float:
    """The measure of places of u and v on their rays, and of directions of these, per measure of the line of uv.

    du dv = |au| |uv| |vb| / (sin at u * sin at v) times measures of the three lines that do not depend on u and v.
    """
    lengths = distance(graph, a, u) * distance(graph, u, v) * distance(graph, v, b)
    return lengths / (corner_sine(graph, u, a, v) * corner_sine(graph, v, u, b))


@core
def turn_ratio(
    graph: Graph, tuning: np.ndarray, x: float, y: float, angle: float, u: int, v: int, p: int, q: int
) -> float:
    """Density of the turn back over that of the turn; 0 where the pivot is not on the new edge pq."""
    px = graph.vertex_xy[p, 0]
    py = graph.vertex_xy[p, 1]
    length = distance(graph, p, q)
    foot = ((x - px) * (graph.vertex_xy[q, 0] - px) + (y - py) * (graph.vertex_xy[q, 1] - py)) / length
    if not 0.0 < foot < length or abs(angle) > STEEPEST:
        return 0.0
    half = 0.5 * abs(angle)
    reach = tuning[c.LINE_REACH]
    return reach_density(half * length, reach) / reach_density(half * distance(graph, u, v), reach)


@core
def propose_line(graph: Graph, proposal: Proposal, tuning: np.ndarray, rng: np.random.Generator) -> tuple[bool, float]:
    """A uniform edge uv with interior ends; a and b, the other neighbours of u and v, stay, and so do their rays."""
    if graph.counts[c.EDGES] == 0:
        return False, 0.0
    e = pick(graph, c.EDGES, rng)
    u, v = ends_of(graph, e)
    if not (may_go(graph, u) and may_go(graph, v)):
        return False, 0.0
    first, a = beyond(graph, u, e)
    last, b = beyond(graph, v, e)
    x, y, tx, ty, angle = draw_line(graph, tuning, u, v, rng)
    p = place_on_ray(graph, proposal, a, u, x, y, tx, ty)
    if p == c.NONE:
        return False, 0.0
    q = place_on_ray(graph, proposal, b, v, x, y, tx, ty)
    if q == c.NONE:
        return False, 0.0
    ratio = measure_of_line(graph, a, p, q, b) / measure_of_line(graph, a, u, v, b)
    if angle != 0.0:
        ratio *= turn_ratio(graph, tuning, x, y, angle, u, v, p, q)
    if ratio == 0.0:
        return False, 0.0
    for edge in (first, e, last):
        drop_edge(proposal, edge)
    drop_vertex(proposal, u)
    drop_vertex(proposal, v)
    join(graph, proposal, a, p)
    join(graph, proposal, p, q)
    join(graph, proposal, q, b)
    for vertex in (a, u, v, b):
        turn_at_vertex(graph, proposal, vertex)
    turn_at_vertex(graph, proposal, q)
    turn_at_vertex(graph, proposal, p)
    return True, math.log(ratio)
