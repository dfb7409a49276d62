"""Features of a sonar: visible parts of edges and visible corners in its cone (paper, section 2.3).

Everything is in the frame of the sonar: it is at the origin and looks along x. Edges are clipped to the cone and to
its reach; as they do not cross, the nearest changes only at slopes of ends. A ray is named by its slope, the tangent of
its angle: in order like the angle, as cones are narrower than pi, and found faster.
"""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core

# The first columns of ``prf.kernels.readings.cones.Cones.pose`` place the sonar.
POSE_X = 0
POSE_Y = 1
POSE_COS = 2
POSE_SIN = 3
BORDER = 4  # tangent of half of the field of view

# Columns of ``Sight.feature``.
DEPTH = 0  # distance to its closest visible point, m
PROJECTION = 1  # angle between the line of sight and the wall there, radians: pi/2 is face on; corners: 0
SUBTENDED = 2  # angle that it fills, radians; corners: 0
KIND = 3  # SURFACE or CORNER
BEARING = 4  # slope of the ray to the closest visible point
N_FEATURE = 5

SURFACE = 0.0
CORNER = 1.0

# Entries of ``Sight.counts``.
N_LINES = 0
N_FEATURES = 1
MAY_CROSS = 2  # whether edges may cross, as those of walls do (kernels.walls)
N_SIGHT_COUNTS = 3

HIDDEN = 1.0 - 1e-9
"""A corner is hidden by what is nearer than this share of its distance."""

ANGLE_TOL = 1e-9
"""Radians, in the middle of the cone. Nothing thinner is resolved: an end nearer than this to the border of the cone
lies on it, lines seen end on and gaps that rounding leaves are passed over. Their depths would be rounding, too."""


class Sight(NamedTuple):
    """Scratch of one chain: edges clipped to a cone, and the features found."""

    line: Array  # (room, 4) f8 ends a, b of the clipped edges, b counter-clockwise of a
    slope: Array  # (room, 2) f8 of the rays to both ends
    corner: Array  # (room, 2) i4 interior vertex at either end; NONE where the edge is cut or meets the border
    bound: Array  # (2 room,) f8 slopes of all ends, ascending
    feature: Array  # (4 room, N_FEATURE) f8
    rank: Array  # (4 room,) i4 features, nearest first
    counts: Array  # (N_SIGHT_COUNTS,) i8


@core
def clip_half_plane(along: float, change: float, low: float, high: float) -> tuple[float, float]:
    """Part of [low, high] in which along + t change >= 0; empty if the second bound is below the first."""
    if change > 0.0:
        return max(low, -along / change), high
    if change < 0.0:
        return low, min(high, along / -change)
    return (low, high) if along >= 0.0 else (1.0, 0.0)


@core
def clip_disc(ax: float, ay: float, dx: float, dy: float, reach: float, low: float, high: float) -> tuple[float, float]:
    """Part of [low, high] in which |a + t d| <= reach; empty if the second bound is below the first."""
    square = dx * dx + dy * dy
    half = (ax * dx + ay * dy) / square
    root = half * half - (ax * ax + ay * ay - reach * reach) / square
    if root <= 0.0:
        return 1.0, 0.0
    width = math.sqrt(root)
    return max(low, -half - width), min(high, -half + width)


@core
def clip_edge(pose: Array, reach: float, xy: Array, line: Array) -> tuple[float, float]:
    """Part of an edge with ends `xy` (4,) that lies in the cone of `pose` and its reach, as bounds in [0, 1].

    It is empty if the second bound is below the first. `line` (4,) takes the whole edge in the frame of the sonar.
    """
    ax = (xy[0] - pose[POSE_X]) * pose[POSE_COS] + (xy[1] - pose[POSE_Y]) * pose[POSE_SIN]
    ay = (xy[1] - pose[POSE_Y]) * pose[POSE_COS] - (xy[0] - pose[POSE_X]) * pose[POSE_SIN]
    bx = (xy[2] - pose[POSE_X]) * pose[POSE_COS] + (xy[3] - pose[POSE_Y]) * pose[POSE_SIN]
    by = (xy[3] - pose[POSE_Y]) * pose[POSE_COS] - (xy[2] - pose[POSE_X]) * pose[POSE_SIN]
    line[0] = ax
    line[1] = ay
    line[2] = bx
    line[3] = by
    border = pose[BORDER]
    low, high = clip_half_plane(border * ax + ay, border * (bx - ax) + (by - ay), 0.0, 1.0)
    low, high = clip_half_plane(border * ax - ay, border * (bx - ax) - (by - ay), low, high)
    if low >= high:
        return 1.0, 0.0
    return clip_disc(ax, ay, bx - ax, by - ay, reach, low, high)


@core
def see_edge(sight: Sight, pose: Array, reach: float, xy: Array, first: int, second: int) -> None:
    """Enter the part of an edge with ends `xy` (4,) that lies in the cone of `pose`, if any.

    `first` and `second` are the vertices at its ends, NONE on the border: there the window ends, not the wall.
    """
    n = sight.counts[N_LINES]
    line = sight.line[n]
    low, high = clip_edge(pose, reach, xy, line)
    if low >= high:
        return
    ax = line[0]
    ay = line[1]
    bx = line[2]
    by = line[3]
    px = ax + low * (bx - ax) if low > 0.0 else ax
    py = ay + low * (by - ay) if low > 0.0 else ay
    qx = ax + high * (bx - ax) if high < 1.0 else bx
    qy = ay + high * (by - ay) if high < 1.0 else by
    if not (px > 0.0 and qx > 0.0):
        return
    p = snapped(py / px, pose[BORDER])
    q = snapped(qy / qx, pose[BORDER])
    if abs(q - p) < ANGLE_TOL:
        return
    swap = 1 if q < p else 0
    line[2 * swap] = px
    line[2 * swap + 1] = py
    line[2 - 2 * swap] = qx
    line[3 - 2 * swap] = qy
    sight.slope[n, swap] = p
    sight.slope[n, 1 - swap] = q
    sight.corner[n, swap] = first if low <= 0.0 else c.NONE
    sight.corner[n, 1 - swap] = second if high >= 1.0 else c.NONE
    sight.counts[N_LINES] = n + 1


@core
def snapped(slope: float, border: float) -> float:
    """The slope, or that of the cone's border next to it, so that a line cut there covers the field of view."""
    if slope > border - ANGLE_TOL * (1.0 + border * border):
        return border
    if slope < ANGLE_TOL * (1.0 + border * border) - border:
        return -border
    return slope


@core
def ahead(sight: Sight, line: int, slope: float) -> float:
    """Distance along the axis of the cone at which the ray of this slope meets a line that spans it."""
    ax = sight.line[line, 0]
    ay = sight.line[line, 1]
    dx = sight.line[line, 2] - ax
    dy = sight.line[line, 3] - ay
    return (ax * dy - ay * dx) / (dy - slope * dx)


@core
def depth_at(sight: Sight, line: int, slope: float) -> float:
    """Distance along the ray of this slope to a line that spans it."""
    return ahead(sight, line, slope) * math.sqrt(1.0 + slope * slope)


@core
def sort_bounds(sight: Sight) -> int:
    """Sort the slopes of all ends (insertion sort: they are few); return their number."""
    n = 0
    for line in range(sight.counts[N_LINES]):
        for end in range(2):
            slope = sight.slope[line, end]
            place = n
            while place > 0 and sight.bound[place - 1] > slope:
                sight.bound[place] = sight.bound[place - 1]
                place -= 1
            sight.bound[place] = slope
            n += 1
    return n if sight.counts[MAY_CROSS] == 0 else sort_crossings(sight, n)


@core
def sort_crossings(sight: Sight, n: int) -> int:
    """Sort the slopes of all crossings of lines among the `n` bounds; return how many there are then.

    What finds no room is passed over: the nearest line is then found in the middle of a gap in which it changes.
    """
    for one in range(sight.counts[N_LINES]):
        ax, ay = sight.line[one, 0], sight.line[one, 1]
        dx, dy = sight.line[one, 2] - ax, sight.line[one, 3] - ay
        for other in range(one):
            low = max(sight.slope[one, 0], sight.slope[other, 0])
            high = min(sight.slope[one, 1], sight.slope[other, 1])
            if not low < high:
                continue
            before = ahead(sight, one, low) - ahead(sight, other, low)
            after = ahead(sight, one, high) - ahead(sight, other, high)
            if before * after >= 0.0 or n == sight.bound.shape[0]:
                continue
            px, py = sight.line[other, 0], sight.line[other, 1]
            qx, qy = sight.line[other, 2] - px, sight.line[other, 3] - py
            along = ((px - ax) * qy - (py - ay) * qx) / (dx * qy - dy * qx)
            slope = (ay + along * dy) / (ax + along * dx)
            place = n
            while place > 0 and sight.bound[place - 1] > slope:
                sight.bound[place] = sight.bound[place - 1]
                place -= 1
            sight.bound[place] = slope
            n += 1
    return n


@core
def nearest_line(sight: Sight, low: float, high: float) -> int:
    """The nearest, in their middle, of the lines that span two slopes; NONE if there is none."""
    middle = 0.5 * (low + high)
    front = c.NONE
    nearest = math.inf
    for line in range(sight.counts[N_LINES]):
        if sight.slope[line, 0] <= low and sight.slope[line, 1] >= high:
            x = ahead(sight, line, middle)
            if x < nearest:
                nearest = x
                front = line
    return front


@core
def is_before(one: Array, other: Array) -> bool:
    """Total order of features."""
    if one[DEPTH] != other[DEPTH]:
        return one[DEPTH] < other[DEPTH]
    if one[BEARING] != other[BEARING]:
        return one[BEARING] < other[BEARING]
    return one[KIND] < other[KIND]


@core
def add_feature(sight: Sight, depth: float, projection: float, subtended: float, kind: float, bearing: float) -> None:
    """Store a feature, and rank it by depth, ties by bearing and kind (insertion sort: they are few)."""
    n = sight.counts[N_FEATURES]
    sight.feature[n, DEPTH] = depth
    sight.feature[n, PROJECTION] = projection
    sight.feature[n, SUBTENDED] = subtended
    sight.feature[n, KIND] = kind
    sight.feature[n, BEARING] = bearing
    sight.counts[N_FEATURES] = n + 1
    place = n
    while place > 0 and is_before(sight.feature[n], sight.feature[sight.rank[place - 1]]):
        sight.rank[place] = sight.rank[place - 1]
        place -= 1
    sight.rank[place] = n


@core
def add_surface(sight: Sight, line: int, low: float, high: float) -> float:
    """Store the part of a line that is seen between two slopes; return the distance of its farther end."""
    dx = sight.line[line, 2] - sight.line[line, 0]
    dy = sight.line[line, 3] - sight.line[line, 1]
    from_low = depth_at(sight, line, low)
    from_high = depth_at(sight, line, high)
    depth = min(from_low, from_high)
    foot = low if from_low < from_high else high
    if low * dy < -dx < high * dy or high * dy < -dx < low * dy:
        foot = -dx / dy  # the ray that meets the line at a right angle
        depth = depth_at(sight, line, foot)
    projection = math.atan2(abs(dy - foot * dx), abs(dx + foot * dy))
    subtended = math.atan2(high - low, 1.0 + low * high)
    add_feature(sight, depth, projection, subtended, SURFACE, foot)
    return max(from_low, from_high)


@core
def add_corner(sight: Sight, line: int, end: int, front: int) -> None:
    """Store the corner at an end of a line if nothing is before it and it is not stored already."""
    vertex = sight.corner[line, end]
    if vertex == c.NONE:
        return
    slope = sight.slope[line, end]
    x = sight.line[line, 2 * end]
    y = sight.line[line, 2 * end + 1]
    is_own = sight.corner[front, 0] == vertex or sight.corner[front, 1] == vertex
    if not is_own and ahead(sight, front, slope) < HIDDEN * x:
        return
    depth = math.sqrt(x * x + y * y)
    for i in range(sight.counts[N_FEATURES]):
        at = sight.feature[i]
        if at[KIND] == CORNER and at[BEARING] == slope and at[DEPTH] == depth:
            return
    add_feature(sight, depth, 0.0, 0.0, CORNER, slope)


@core
def add_corners(sight: Sight, slope: float) -> None:
    """Store the visible corners on the ray of this slope."""
    front = nearest_line(sight, slope, slope)
    for line in range(sight.counts[N_LINES]):
        for end in range(2):
            if sight.slope[line, end] == slope:
                add_corner(sight, line, end, front)


@core
def sweep(sight: Sight, border: float, reach: float) -> float:
    """Find the features of the lines entered; return up to where the map matters to this sonar.

    That is the farthest visible point where the whole field of view is covered, else `reach`. Between two neighbouring
    slopes of ends one line is nearest, or none.
    """
    sight.counts[N_FEATURES] = 0
    n = sort_bounds(sight)
    extent = 0.0
    front = c.NONE
    since = -border
    for i in range(n):
        slope = sight.bound[i]
        if i + 1 < n and sight.bound[i + 1] == slope:
            continue
        add_corners(sight, slope)
        now = nearest_line(sight, slope, sight.bound[i + 1]) if i + 1 < n else c.NONE
        if now != front:
            if slope - since > ANGLE_TOL:
                extent = max(extent, add_surface(sight, front, since, slope) if front != c.NONE else reach)
            front = now
            since = slope
    return extent if since >= border and n > 0 else reach
