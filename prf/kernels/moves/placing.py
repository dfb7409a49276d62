"""Random places in the window, on its sides and beside edges, with their densities."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import Proposal, add_vertex

N_SIZES = 3
SHRINKING = 0.3
"""Aimed births have so many sizes, each so many times the one before."""


@core
def random_reach(rng: Rng, median: float) -> float:
    """Distance with density median / (median + r)^2: flat near zero, and no scale is out of reach."""
    u = rng.random()
    return median * u / (1.0 - u)


@core
def reach_of(tuning: Array, size: int) -> float:
    """Median distance of the vertices of an aimed birth of a size, m."""
    median = tuning[c.AIM_REACH]
    for _ in range(size):
        median *= SHRINKING
    return median


@core
def reach_density(r: float, median: float) -> float:
    """Density of :func:`random_reach` at r >= 0."""
    return median / ((median + r) * (median + r))


@core
def log_or_minus_infinity(density: float) -> float:
    """Log of a density that may be 0."""
    return math.log(density) if density > 0.0 else -math.inf


@core
def near_density(distance: float, median: float) -> float:
    """Density in the plane of a point at a :func:`random_reach` in a uniform direction."""
    return reach_density(distance, median) / (2.0 * math.pi * distance)


@core
def beside(u: Array, w: Array, median: float, rng: Rng) -> tuple[float, float]:
    """Point whose foot is uniform on the segment from u to w (2,), at a :func:`signed_reach` from it."""
    ex = w[0] - u[0]
    ey = w[1] - u[1]
    foot = rng.random()
    offset = -signed_reach(rng, median) / math.sqrt(ex * ex + ey * ey)
    return u[0] + foot * ex - offset * ey, u[1] + foot * ey + offset * ex


@core
def beside_density(u: Array, w: Array, x: float, y: float, median: float) -> float:
    """Density in the plane with which :func:`beside` gives (x, y); 0 where the foot is off the segment."""
    ex = w[0] - u[0]
    ey = w[1] - u[1]
    square = ex * ex + ey * ey
    foot = ((x - u[0]) * ex + (y - u[1]) * ey) / square
    if not 0.0 < foot < 1.0:
        return 0.0
    length = math.sqrt(square)
    offset = abs(ex * (y - u[1]) - ey * (x - u[0])) / length
    return 0.5 * reach_density(offset, median) / length


@core
def is_level(side: int) -> bool:
    """Whether a side of the window runs along x."""
    return side == c.BOTTOM or side == c.TOP


@core
def side_length(window: Array, side: int) -> float:
    """Length of a side of the window (4,)."""
    return window[2] - window[0] if is_level(side) else window[3] - window[1]


@core
def perimeter(window: Array) -> float:
    """Length of the window's border."""
    return 2.0 * (window[2] - window[0] + window[3] - window[1])


@core
def area(window: Array) -> float:
    """Area of the window."""
    return (window[2] - window[0]) * (window[3] - window[1])


@core
def side_point(window: Array, side: int, position: float) -> tuple[float, float]:
    """Point of a side at `position`, its coordinate along the side; the other coordinate is exactly the side's."""
    if side == c.BOTTOM:
        return position, window[1]
    if side == c.TOP:
        return position, window[3]
    if side == c.LEFT:
        return window[0], position
    return window[2], position


@core
def side_start(window: Array, side: int) -> float:
    """Smallest coordinate along a side."""
    return window[0] if is_level(side) else window[1]


@core
def position_of(graph: Graph, side: int, v: int) -> float:
    """Coordinate along a side of the foot of a vertex on it."""
    return graph.vertex_xy[v, 0] if is_level(side) else graph.vertex_xy[v, 1]


@core
def is_on_side(window: Array, side: int, position: float) -> bool:
    """Whether a coordinate along the side lies strictly inside it."""
    start = side_start(window, side)
    return start < position < start + side_length(window, side)


@core
def is_inside(window: Array, x: float, y: float) -> bool:
    """Whether the point lies strictly inside the window."""
    return window[0] < x < window[2] and window[1] < y < window[3]


@core
def random_side(window: Array, rng: Rng) -> int:
    """Side with probability in proportion to its length."""
    u = rng.random() * perimeter(window)
    for side in range(3):
        u -= side_length(window, side)
        if u < 0.0:
            return side
    return 3


@core
def random_position(window: Array, side: int, rng: Rng) -> float:
    """Uniform coordinate along a side."""
    return side_start(window, side) + rng.random() * side_length(window, side)


@core
def corner_between(window: Array, side: int, other: int) -> tuple[float, float]:
    """Corner of the window in which two adjacent sides meet."""
    x = window[2] if side == c.RIGHT or other == c.RIGHT else window[0]
    y = window[3] if side == c.TOP or other == c.TOP else window[1]
    return x, y


@core
def distance_to_corner(window: Array, side: int, other: int, position: float) -> float:
    """Distance of a point of `side` from the corner in which it meets the adjacent side `other`."""
    x, y = corner_between(window, side, other)
    return abs(position - (x if is_level(side) else y))


@core
def position_from_corner(window: Array, side: int, other: int, distance: float) -> float:
    """Coordinate along `side` at a distance from the corner in which it meets `other`."""
    x, y = corner_between(window, side, other)
    corner = x if is_level(side) else y
    return corner - distance if corner > side_start(window, side) else corner + distance


@core
def foot_and_offset(graph: Graph, a: int, b: int, v: int) -> tuple[float, float, float]:
    """Distance of v's foot from a along the line ab, signed offset from it, and the length of ab."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    ex = graph.vertex_xy[b, 0] - ax
    ey = graph.vertex_xy[b, 1] - ay
    length = math.sqrt(ex * ex + ey * ey)
    vx = graph.vertex_xy[v, 0] - ax
    vy = graph.vertex_xy[v, 1] - ay
    return (vx * ex + vy * ey) / length, (ex * vy - ey * vx) / length, length


@core
def signed_density(x: float, median: float) -> float:
    """Density of a random reach to either side."""
    return 0.5 * reach_density(abs(x), median)


@core
def signed_reach(rng: Rng, median: float) -> float:
    """Random reach to either side."""
    reach = random_reach(rng, median)
    return reach if rng.random() < 0.5 else -reach


@core
def place_at_offset(graph: Graph, proposal: Proposal, a: int, b: int, foot: float, off: float) -> int:
    """New vertex at a foot along ab and an offset from the line."""
    ax = graph.vertex_xy[a, 0]
    ay = graph.vertex_xy[a, 1]
    ex = graph.vertex_xy[b, 0] - ax
    ey = graph.vertex_xy[b, 1] - ay
    length = math.sqrt(ex * ex + ey * ey)
    x = ax + (foot * ex - off * ey) / length
    y = ay + (foot * ey + off * ex) / length
    return add_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def is_in_window(graph: Graph, v: int) -> bool:
    """Whether a vertex lies strictly inside the window."""
    return is_inside(graph.window, graph.vertex_xy[v, 0], graph.vertex_xy[v, 1])


@core
def place_two(
    graph: Graph, proposal: Proposal, a: int, b: int, foot_s: float, foot_t: float, length: float, near: float, rng: Rng
) -> bool:
    """Place two new vertices a little off two feet on the edge ab; False if one is off the edge or the window."""
    if not (0.0 < foot_s < length and 0.0 < foot_t < length):
        return False
    s = place_at_offset(graph, proposal, a, b, foot_s, signed_reach(rng, near))
    t = place_at_offset(graph, proposal, a, b, foot_t, signed_reach(rng, near))
    return is_in_window(graph, s) and is_in_window(graph, t)


@core
def uniform_vertex(graph: Graph, proposal: Proposal, rng: Rng) -> int:
    """New vertex, uniform in the window."""
    window = graph.window
    x = window[0] + rng.random() * (window[2] - window[0])
    y = window[1] + rng.random() * (window[3] - window[1])
    return add_vertex(graph, proposal, x, y, c.INTERIOR)


@core
def vertex_near(graph: Graph, proposal: Proposal, u: int, median: float, rng: Rng) -> int:
    """New vertex near u, perhaps outside the window."""
    r = random_reach(rng, median)
    direction = 2.0 * math.pi * rng.random()
    x = graph.vertex_xy[u, 0] + r * math.cos(direction)
    y = graph.vertex_xy[u, 1] + r * math.sin(direction)
    return add_vertex(graph, proposal, x, y, c.INTERIOR)
