"""Equations 6 to 13 of the paper by brute force, written from its text: all pairs of points, hulls, quantiles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

Floats = NDArray[np.float64]


class Sheet(NamedTuple):
    """A patch: points (n, 3), their mean, unit vectors across, along and normal as rows, cell side, area."""

    points: Floats
    centre: Floats
    axes: Floats
    cell: float
    area: float


def rho(one: Floats, other: Floats) -> float:
    """Equation 9: the distance of the closest points."""
    return float(np.linalg.norm(one[:, None] - other, axis=2).min())


def neighbours(patches: Sequence[Floats], n_neighbours: int, radius: float) -> dict[tuple[int, int], float]:
    """Section 3: each patch's closest others within the radius, largest first among equals, then by their mean."""
    found = {}
    for i, one in enumerate(patches):
        near = []
        for j, other in enumerate(patches):
            if i != j and rho(one, other) <= radius:
                near.append((rho(one, other), -len(other), *other.mean(axis=0), j))
        for distance, *_, j in sorted(near)[:n_neighbours]:
            found[min(i, j), max(i, j)] = distance
    return found


def mean_squared_error(points: Floats) -> float:
    """The denominator of equation 6, of the plane of least squares."""
    centred = points - points.mean(axis=0)
    return float(np.linalg.svd(centred, compute_uv=False)[-1] ** 2 / len(points)) if len(points) >= 3 else 0.0


def spread(points: Floats, normal: Floats) -> float:
    """P95 - P5 of the signed distances from the plane."""
    low, high = np.percentile((points - points.mean(axis=0)) @ normal, [5, 95])
    return float(high - low)


def hull_size(points: Floats) -> float:
    """Volume or area of the convex hull, 0 where it is flat."""
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def literal_node(points: Floats, normal: Floats) -> list[float]:
    """Equations 6, 7 and 8 as printed."""
    cosine = normal[2] if normal[2] != 0 else math.copysign(1e-300, normal[2])
    return [1 / mean_squared_error(points), 1 / cosine, hull_size(points) / hull_size(points[:, :2])]


def literal_edge(one: Floats, other: Floats, normals: tuple[Floats, Floats], tau: float) -> tuple[float, ...]:
    """rho, W, A, R and x of equations 9 to 13 as printed; shadows are plain, denominators in the XY plane."""
    n, m = normals
    distance = rho(one, other)
    weight = math.exp(-distance / tau)
    shadow = max(in_plane_area(one, n), in_plane_area(other, m)) * abs(float(n @ m))
    overlap = shadow / min(hull_size(one[:, :2]), hull_size(other[:, :2]))
    crossing = min(edge_ratio(one, n, other, m), edge_ratio(other, m, one, n))
    return distance, weight, overlap, crossing, 1 - weight * (overlap + crossing)


def in_plane_area(points: Floats, normal: Floats) -> float:
    """Area of the hull of the points in the plane with this normal."""
    _, _, axes = np.linalg.svd(normal[None])
    return hull_size(points @ axes[1:].T)


def line_of_planes(p: Floats, n: Floats, q: Floats, m: Floats) -> tuple[Floats, Floats]:
    """A point and the direction of the line in which planes through p and q meet."""
    direction = np.cross(n, m)
    point = np.linalg.lstsq(np.stack([n, m]), np.array([n @ p, m @ q]))[0]
    return point, direction / np.linalg.norm(direction)


def places(points: Floats, n: Floats, others: Floats, m: Floats) -> tuple[Floats, Floats]:
    """Places of points in their own plane: across the line of intersection, and along it (from a point of it)."""
    middle = points.mean(axis=0)
    point, direction = line_of_planes(middle, n, others.mean(axis=0), m)
    flat = points - ((points - middle) @ n)[:, None] * n
    return (flat - point) @ np.cross(n, direction), (flat - point) @ direction


def edge_ratio(points: Floats, n: Floats, others: Floats, m: Floats) -> float:
    """r_ij of figure 2a: distance of the nearer edge from the line over that of the farther."""
    across, _ = places(points, n, others, m)
    edges = sorted([abs(across.min()), abs(across.max())])
    return float(edges[0] / edges[1])


def safe_crossing(one: Sheet, other: Sheet, spacing: float, beyond: float) -> float:
    """R where both patches lie on both sides of the line and side by side along it, else 0; see docs/features.md."""
    n, m = one.axes[2], other.axes[2]
    slack = spacing + beyond / float(np.linalg.norm(np.cross(n, m)))
    own, their = places(one.points, n, other.points, m), places(other.points, m, one.points, n)
    origin, direction = line_of_planes(one.points.mean(axis=0), n, other.points.mean(axis=0), m)
    back, _ = line_of_planes(other.points.mean(axis=0), m, one.points.mean(axis=0), n)
    swap = -1.0  # the direction of the line turns round when the planes are swapped
    along = [own[1], swap * their[1] + (back - origin) @ direction]
    if min(_ratio(own[0], slack), _ratio(their[0], slack)) == 0:
        return 0.0
    low = max(np.quantile(s, 0.02) for s in along)
    high = min(np.quantile(s, 0.98) for s in along)
    if high - low <= spacing:
        return 0.0
    shared = [(s >= low) & (s <= high) for s in along]
    ratio = min(_ratio(own[0][shared[0]], slack), _ratio(their[0][shared[1]], slack))
    if ratio == 0:
        return 0.0
    n_steps = max(int((high - low) / max(4 * spacing, 2 * one.cell, 2 * other.cell) + 0.5), 1)
    steps = np.linspace(low, high, n_steps + 1)
    crossed = np.ones(n_steps, bool)
    for sheet, (across, _), s, some in zip((one, other), (own, their), along, shared, strict=True):
        for t in (across, -across):
            edge = np.quantile(t[some], 0.98)
            beside = (t > slack) & (t <= min(edge, 2 * slack + 3 * spacing))
            count = np.histogram(s[beside], steps)[0]
            area = (high - low) / n_steps * min(edge - slack, slack + 3 * spacing)
            crossed &= count >= max(1.0, 0.15 * len(t) / sheet.area * area)
    steep = min(float(np.linalg.norm(np.cross(n, m))) / 0.17, 1.0)
    return ratio * (1 - steep * (1 - float(crossed.mean())))


def _ratio(across: Floats, slack: float) -> float:
    if len(across) == 0:
        return 0.0
    edges = sorted([-np.quantile(across, 0.02) - slack, np.quantile(across, 0.98) - slack])
    return float(edges[0] / edges[1]) if edges[0] > 0 else 0.0


def sides(right: Floats, above: Floats) -> NDArray[np.int64]:
    """Side of a place on which points lie: 0 right, 1 left, 2 above, 3 below, parted by the diagonals."""
    level = np.abs(right) >= np.abs(above)
    return np.where(level, np.where(right >= 0, 0, 1), np.where(above > 0, 2, 3))


def point_gaps(places: Floats, cell: float) -> Floats:
    """Gap (n,) of each point, given in the plane; see docs/features.md. Searched up to 1, 2, then 3 cells away."""
    gaps = []
    for place in places:
        ray = places - place
        distance = np.hypot(*ray.T)
        for reach in (cell, 2 * cell, 3 * cell):
            near = np.flatnonzero((distance > 0) & (distance < reach))
            four = near[np.argsort(distance[near], kind="stable")[:4]]
            gap = distance[four[3]] if len(four) == 4 else reach
            across, along = np.linalg.eigvalsh(ray[four].T @ ray[four])
            if across < 0.02 * along:
                side = sides(*ray[near].T)
                gap = sorted(distance[near][side == k].min(initial=reach) for k in range(4))[2]
            if gap < reach:
                break
        gaps.append(gap)
    return np.array(gaps)


def is_covered(place: Floats, places: Floats, gaps: Floats, cell: float) -> bool:
    """Whether points surround a place: on all four sides within two gaps of the closest, itself within a cell."""
    ray = places - place
    distance = np.hypot(*ray.T)
    closest = int(np.argmin(distance))
    reach = 2 * gaps[closest]
    if distance[closest] >= min(cell, reach):
        return False
    near = (distance > 1e-6 * reach) & (distance < reach)
    return len(np.unique(sides(*ray[near].T))) == 4


def safe_overlap(one: Sheet, other: Sheet, radius: float, tau: float, tolerance: float) -> tuple[float, float]:
    """A and the covered area of two patches point by point; tolerance 0: all that is covered counts."""
    cosine = float(one.axes[2] @ other.axes[2])
    facing = max(0.0, 2 * cosine**2 - 1)
    overlap = covered_area = 0.0
    for own, their in ((one, other), (other, one)):
        gaps, their_gaps, their_places = (
            point_gaps((own.points - own.centre) @ own.axes[:2].T, own.cell),
            point_gaps((their.points - their.centre) @ their.axes[:2].T, their.cell),
            (their.points - their.centre) @ their.axes[:2].T,
        )
        ray = (own.points - their.centre) @ their.axes.T
        covered = np.array([is_covered(place, their_places, their_gaps, their.cell) for place in ray[:, :2]])
        areas = (own.area * gaps**2 / (gaps**2).sum())[covered]
        offsets = np.abs(ray[covered, 2])
        counts = np.ones(len(areas))
        if tolerance > 0:
            counts = (
                1
                / (1 + (tolerance / np.maximum(offsets, 1e-9)) ** 8)
                * np.exp(-(offsets - offsets.min(initial=math.inf)) / tau)
            )
            counts[offsets > radius] = 0.0
        overlap = max(overlap, min(1.0, facing * float(areas @ counts) / min(one.area, other.area)))
        covered_area = max(covered_area, float(areas.sum()))
    return overlap, covered_area if facing > 0 else 0.0


def ideal_overlap(
    one: tuple[Floats, Floats, float, float],
    other: tuple[Floats, Floats, float, float],
    tau: float,
    tolerance: float,
    steps: int = 300,
) -> float:
    """A of two exact rectangles (middle, axes as rows, width, height), of points without gaps: by a grid on each."""
    facing = max(0.0, 2 * float(one[1][2] @ other[1][2]) ** 2 - 1)
    largest = 0.0
    for (c, axes, w, h), (d, others, v, g) in ((one, other), (other, one)):
        ticks = (np.arange(steps) + 0.5) / steps - 0.5
        u, y = np.meshgrid(ticks * w, ticks * h)
        ray = (c + u.reshape(-1, 1) * axes[0] + y.reshape(-1, 1) * axes[1] - d) @ others.T
        offsets = np.abs(ray[(np.abs(ray[:, 0]) <= 0.5 * v) & (np.abs(ray[:, 1]) <= 0.5 * g), 2])
        counts = np.ones(len(offsets))
        if tolerance > 0:
            counts = np.exp(-(offsets - offsets.min(initial=math.inf)) / tau)
            counts /= 1 + (tolerance / np.maximum(offsets, 1e-9)) ** 8
        largest = max(largest, facing * float(counts.sum()) * w * h / steps**2 / min(w * h, v * g))
    return min(1.0, largest)
