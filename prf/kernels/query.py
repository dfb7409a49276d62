"""Squares and paths against the edges of many stored colorings.

Points come sorted by x: an edge then meets only the points of its own band of x, found by bisection
(2,000 points in 2,000 draws of 2,300 edges: 2.5 CPU seconds).
"""

from __future__ import annotations

import numpy as np

from prf.kernels._jit import jit
from prf.kernels.geometry import segments_meet


@jit
def segment_meets_square(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, half: float) -> bool:
    """Whether segment a-b has a point in the closed square round c: separating axes x, y and the segment's normal."""
    if min(ax, bx) > cx + half or max(ax, bx) < cx - half or min(ay, by) > cy + half or max(ay, by) < cy - half:
        return False
    normal_x, normal_y = ay - by, bx - ax
    return abs(normal_x * (cx - ax) + normal_y * (cy - ay)) <= half * (abs(normal_x) + abs(normal_y))


@jit
def mark_squares(points: np.ndarray, half: float, a: np.ndarray, b: np.ndarray, marked: np.ndarray) -> None:
    """Set `marked` for every point (rows sorted by x) whose closed square of half side `half` meets the edge a-b."""
    last = max(a[0], b[0]) + half
    for i in range(np.searchsorted(points[:, 0], min(a[0], b[0]) - half), points.shape[0]):
        if points[i, 0] > last:
            break
        if not marked[i] and segment_meets_square(a[0], a[1], b[0], b[1], points[i, 0], points[i, 1], half):
            marked[i] = True


@jit
def draws_mark_squares(
    points: np.ndarray,
    half: float,
    vertex_offsets: np.ndarray,
    xy: np.ndarray,
    edge_offsets: np.ndarray,
    edges: np.ndarray,
    marked: np.ndarray,
) -> None:
    """Set ``marked`` (n_draws, n_points), for points sorted by x, where an edge of the draw meets the square."""
    for draw in range(marked.shape[0]):
        first = vertex_offsets[draw]
        for e in range(edge_offsets[draw], edge_offsets[draw + 1]):
            mark_squares(points, half, xy[first + edges[e, 0]], xy[first + edges[e, 1]], marked[draw])


@jit
def point_segment_distance2(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance from p to segment a-b (a single point allowed)."""
    dx, dy = bx - ax, by - ay
    length2 = dx * dx + dy * dy
    along = 0.0
    if length2 > 0.0:
        along = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    return (px - ax - along * dx) ** 2 + (py - ay - along * dy) ** 2


@jit
def segment_distance2(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> float:
    """Squared distance between segments a-b and c-d: 0 where they meet, else the least over the four ends."""
    if segments_meet(a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]):
        return 0.0
    from_ab = min(
        point_segment_distance2(a[0], a[1], c[0], c[1], d[0], d[1]),
        point_segment_distance2(b[0], b[1], c[0], c[1], d[0], d[1]),
    )
    from_cd = min(
        point_segment_distance2(c[0], c[1], a[0], a[1], b[0], b[1]),
        point_segment_distance2(d[0], d[1], a[0], a[1], b[0], b[1]),
    )
    return min(from_ab, from_cd)


@jit
def edge_near_path(a: np.ndarray, b: np.ndarray, path: np.ndarray, radius: float) -> bool:
    """Whether the edge a-b comes within `radius` of the polyline `path`; boxes are compared before distances."""
    for piece in range(path.shape[0] - 1):
        c, d = path[piece], path[piece + 1]
        if max(a[0], b[0]) < min(c[0], d[0]) - radius or min(a[0], b[0]) > max(c[0], d[0]) + radius:
            continue
        if max(a[1], b[1]) < min(c[1], d[1]) - radius or min(a[1], b[1]) > max(c[1], d[1]) + radius:
            continue
        if segment_distance2(a, b, c, d) <= radius * radius:
            return True
    return False


@jit
def draws_clear_path(
    path: np.ndarray,
    radius: float,
    vertex_offsets: np.ndarray,
    xy: np.ndarray,
    edge_offsets: np.ndarray,
    edges: np.ndarray,
    clear: np.ndarray,
) -> None:
    """Set ``clear`` (n_draws,): no edge of the draw within `radius` of the polyline `path` (two points at least)."""
    for draw in range(clear.shape[0]):
        first = vertex_offsets[draw]
        clear[draw] = True
        for e in range(edge_offsets[draw], edge_offsets[draw + 1]):
            if edge_near_path(xy[first + edges[e, 0]], xy[first + edges[e, 1]], path, radius):
                clear[draw] = False
                break
