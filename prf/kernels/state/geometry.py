"""Predicates of the plane on plain floats. Degenerate contacts count as crossings: they have probability zero."""

import math

from prf.kernels._jit import Array, core


@core
def orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Twice the signed area of the triangle a, b, c (positive: counter-clockwise)."""
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@core
def segments_meet(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> bool:
    """Whether the closed segments ab and cd have a point in common."""
    if max(ax, bx) < min(cx, dx) or max(cx, dx) < min(ax, bx):
        return False
    if max(ay, by) < min(cy, dy) or max(cy, dy) < min(ay, by):
        return False
    if orientation(ax, ay, bx, by, cx, cy) * orientation(ax, ay, bx, by, dx, dy) > 0.0:
        return False
    return orientation(cx, cy, dx, dy, ax, ay) * orientation(cx, cy, dx, dy, bx, by) <= 0.0


@core
def segment_meets_box(
    ax: float, ay: float, bx: float, by: float, x_min: float, y_min: float, x_max: float, y_max: float
) -> bool:
    """Whether segment ab has a point in a closed box: separating axes x, y and the segment's normal."""
    if min(ax, bx) > x_max or max(ax, bx) < x_min or min(ay, by) > y_max or max(ay, by) < y_min:
        return False
    normal_x = ay - by
    normal_y = bx - ax
    middle = normal_x * (0.5 * (x_min + x_max) - ax) + normal_y * (0.5 * (y_min + y_max) - ay)
    return abs(middle) <= 0.5 * ((x_max - x_min) * abs(normal_x) + (y_max - y_min) * abs(normal_y))


@core
def point_segment_distance2(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Squared distance from p to the segment ab (a single point allowed)."""
    dx = bx - ax
    dy = by - ay
    length2 = dx * dx + dy * dy
    along = 0.0
    if length2 > 0.0:
        along = min(1.0, max(0.0, ((px - ax) * dx + (py - ay) * dy) / length2))
    return (px - ax - along * dx) ** 2 + (py - ay - along * dy) ** 2


@core
def segment_distance2(ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float) -> float:
    """Squared distance between the segments ab and cd: 0 where they meet, else the least over the four ends."""
    if segments_meet(ax, ay, bx, by, cx, cy, dx, dy):
        return 0.0
    return min(
        point_segment_distance2(ax, ay, cx, cy, dx, dy),
        point_segment_distance2(bx, by, cx, cy, dx, dy),
        point_segment_distance2(cx, cy, ax, ay, bx, by),
        point_segment_distance2(dx, dy, ax, ay, bx, by),
    )


@core
def ray_hit(ray: Array, xy: Array) -> float:
    """Distance along a ray (its origin and unit direction come first in `ray`) to the segment with ends `xy` (4,).

    It is inf if the ray misses the segment.

    Each end is classed by the side of the ray's line on which it lies, half open, so that a ray through a vertex
    meets exactly one of two edges that continue each other there: no light leaks between them.
    """
    ox, oy, ux, uy = ray[0], ray[1], ray[2], ray[3]
    ax, ay, bx, by = xy[0], xy[1], xy[2], xy[3]
    vx = ax - ox
    vy = ay - oy
    side_a = ux * vy - uy * vx
    side_b = ux * (by - oy) - uy * (bx - ox)
    if (side_a < 0.0) == (side_b < 0.0):
        return math.inf
    t = (vx * (by - ay) - vy * (bx - ax)) / (side_b - side_a)
    if t > 0.0:
        return t
    return math.inf


@core
def inside_loop(x: float, y: float, loop: Array, n: int) -> bool:
    """Whether the closed polygon of the first `n` rows of `loop` (n, 2) winds round (x, y) an odd number of times."""
    odd = False
    k = n - 1
    for i in range(n):
        yi = loop[i, 1]
        yk = loop[k, 1]
        if (yi > y) != (yk > y) and x < loop[i, 0] + (y - yi) / (yk - yi) * (loop[k, 0] - loop[i, 0]):
            odd = not odd
        k = i
    return odd


@core
def loop_box(loop: Array, n: int) -> tuple[float, float, float, float]:
    """Bounding box of the first n rows of `loop`."""
    x_min = x_max = loop[0, 0]
    y_min = y_max = loop[0, 1]
    for k in range(1, n):
        x_min = min(x_min, loop[k, 0])
        x_max = max(x_max, loop[k, 0])
        y_min = min(y_min, loop[k, 1])
        y_max = max(y_max, loop[k, 1])
    return x_min, y_min, x_max, y_max


@core
def sine_of_angle(vx: float, vy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Sine of the angle at v between the segments va and vb."""
    px = ax - vx
    py = ay - vy
    qx = bx - vx
    qy = by - vy
    return abs(px * qy - py * qx) / math.sqrt((px * px + py * py) * (qx * qx + qy * qy))
