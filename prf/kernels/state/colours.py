"""Colours by parity of a vertical ray: exact with half-open spans, so that passing a vertex needs no special case.

A point has as many edges below it as the ray down from it crosses. An edge spans the abscissae ``lo <= x < hi`` of its
ends: an interior vertex is then met by both of its edges or by one, never by a touch counted once. The ray goes on
along the bottom side to its left corner, past every bottom vertex with abscissa <= x. The colour of the point is the
colour of that corner, switched once for each meeting.
"""

from typing import NamedTuple

import numpy as np

from prf.kernels._jit import Array, jit
from prf.kernels.constants import BOTTOM, LEFT, TOP


class Graphs(NamedTuple):
    """Discontinuity graphs of many draws, as ``prf.model.coloring.Draws`` keeps them."""

    vertex_offsets: Array  # (n_draws + 1,) i8
    xy: Array  # (n, 2) f8
    side: Array  # (n,) i1
    edge_offsets: Array  # (n_draws + 1,) i8
    edges: Array  # (m, 2) i4 vertices, numbered within the draw


@jit
def is_above(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether p lies strictly above the line a-b, where a is the left end."""
    return (bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0.0


@jit
def switch_above_edge(points: Array, a: Array, b: Array, odd: Array) -> None:
    """Switch ``odd`` for each point (rows sorted by x) that lies above the edge a-b within its span."""
    if a[0] > b[0]:
        a, b = b, a
    first = np.searchsorted(points[:, 0], a[0])
    last = np.searchsorted(points[:, 0], b[0])
    for k in range(first, last):
        if is_above(points[k, 0], points[k, 1], a[0], a[1], b[0], b[1]):
            odd[k] = not odd[k]


@jit
def switch_by_graph(points: Array, xy: Array, side: Array, edges: Array, odd: Array) -> None:
    """Switch ``odd`` of each point (rows sorted by x) that meets the graph an odd number of times."""
    for e in range(edges.shape[0]):
        switch_above_edge(points, xy[edges[e, 0]], xy[edges[e, 1]], odd)
    for v in range(xy.shape[0]):
        if side[v] == BOTTOM:
            for k in range(np.searchsorted(points[:, 0], xy[v, 0]), points.shape[0]):
                odd[k] = not odd[k]


@jit
def draws_odd(points: Array, graphs: Graphs) -> Array:
    """Parity of meetings (n_draws, n_points) of each of the points, sorted by x, with each graph."""
    n_draws = graphs.vertex_offsets.shape[0] - 1
    odd = np.zeros((n_draws, points.shape[0]), np.bool_)
    for i in range(n_draws):
        v0, v1 = graphs.vertex_offsets[i], graphs.vertex_offsets[i + 1]
        e0, e1 = graphs.edge_offsets[i], graphs.edge_offsets[i + 1]
        switch_by_graph(points, graphs.xy[v0:v1], graphs.side[v0:v1], graphs.edges[e0:e1], odd[i])
    return odd


@jit
def edges_below(k: int, xy: Array, side: Array, edges: Array) -> int:
    """Return how often the ray down and left from the middle of edge `k` meets the graph, edge `k` itself left out."""
    p = 0.5 * (xy[edges[k, 0]] + xy[edges[k, 1]])
    count = 0
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        if xy[a, 0] > xy[b, 0]:
            a, b = b, a
        if e != k and xy[a, 0] <= p[0] < xy[b, 0] and is_above(p[0], p[1], xy[a, 0], xy[a, 1], xy[b, 0], xy[b, 1]):
            count += 1
    for v in range(xy.shape[0]):
        if side[v] == BOTTOM and xy[v, 0] <= p[0]:
            count += 1
    return count


@jit
def black_top(xy: Array, side: Array, window: Array, left_black: bool) -> float:
    """Return the length of the top side that is black, given the colour of its left corner."""
    black = left_black
    length = -float(window[0]) if left_black else 0.0
    for v in range(xy.shape[0]):
        if side[v] == TOP:
            black = not black
            before = left_black
            for u in range(xy.shape[0]):
                if side[u] == TOP and xy[u, 0] < xy[v, 0]:
                    before = not before
            length += xy[v, 0] if before else -xy[v, 0]
    if black:
        length += window[2]
    return length


@jit
def black_area(xy: Array, side: Array, edges: Array, window: Array, corner_black: bool) -> float:
    """Return the black area of one draw, given the colour of the bottom left corner; O(n_edges^2).

    Each column adds the height of every edge, positive where black lies below it, and the top's where that is black.
    """
    left_black = corner_black
    for v in range(xy.shape[0]):
        if side[v] == LEFT:
            left_black = not left_black
    area = (window[3] - window[1]) * black_top(xy, side, window, left_black)
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        height = 0.5 * (xy[a, 1] + xy[b, 1]) - window[1]
        signed = height * abs(xy[b, 0] - xy[a, 0])
        below_black = corner_black != (edges_below(e, xy, side, edges) % 2 == 1)
        area += signed if below_black else -signed
    return float(area)


@jit
def draws_black_area(window: Array, graphs: Graphs, corner_black: Array) -> Array:
    """Black area (n_draws,) of each graph, given the colours (n_draws,) of the bottom left corner."""
    area = np.empty(corner_black.shape[0])
    for i in range(area.shape[0]):
        v0, v1 = graphs.vertex_offsets[i], graphs.vertex_offsets[i + 1]
        e0, e1 = graphs.edge_offsets[i], graphs.edge_offsets[i + 1]
        area[i] = black_area(graphs.xy[v0:v1], graphs.side[v0:v1], graphs.edges[e0:e1], window, corner_black[i])
    return area
