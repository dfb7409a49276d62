"""Slow, readable twins of what `prf.model.coloring` and `prf.model.arak` compute."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from shapely import LineString

from prf.model.coloring import Coloring
from prf.model.window import INTERIOR, Window

Edge = frozenset[tuple[float, ...]]


def edge_set(coloring: Coloring) -> set[Edge]:
    """Return the edges as unordered pairs of coordinates."""
    return {frozenset(map(tuple, ends.tolist())) for ends in coloring.xy[coloring.edges]}


def slow_black_at(coloring: Coloring, xy: ArrayLike) -> list[bool]:
    """Colour by the definition: parity of the edges that the segment from the anchor crosses."""
    edges = [LineString(ends) for ends in coloring.xy[coloring.edges]]
    paths = [LineString([coloring.window.centre, point]) for point in np.asarray(xy)]
    return [bool(coloring.anchor_black) != (sum(path.intersects(e) for e in edges) % 2 == 1) for path in paths]


def slab_area(coloring: Coloring) -> float:
    """Black area: between neighbouring abscissae of vertices no edges meet, so trapezoids alternate in colour."""
    window = coloring.window
    levels = np.unique([window.x_min, window.x_max, *coloring.xy[:, 0]])
    ends = coloring.xy[coloring.edges]
    black = 0.0
    for left, right in itertools.pairwise(levels):
        middle = 0.5 * (left + right)
        heights = []
        for (ax, ay), (bx, by) in ends:
            if min(ax, bx) < middle < max(ax, bx):
                heights.append(ay + (by - ay) * (middle - ax) / (bx - ax))
        bounds = [window.y_min, *sorted(heights), window.y_max]
        for low, high in itertools.pairwise(bounds):
            if slow_black_at(coloring, [(middle, 0.5 * (low + high))])[0]:
                black += (right - left) * (high - low)
    return black


def slow_log_density(coloring: Coloring, scale: float) -> float:
    """Log h term by term, as equations 1-3 of the paper have it."""
    total = 0.0
    for a, b in coloring.edges:
        length = math.dist(coloring.xy[a], coloring.xy[b])
        total += math.log(scale) - 2.0 * scale * length - math.log(length)
    for v in range(len(coloring.xy)):
        others = [e[1] if e[0] == v else e[0] for e in coloring.edges if v in e]
        angles = [math.atan2(*(coloring.xy[u] - coloring.xy[v])[::-1]) for u in others]
        if coloring.side[v] != INTERIOR:
            angles.append(0.0 if coloring.side[v] in (0, 2) else 0.5 * math.pi)
        total += math.log(abs(math.sin(angles[0] - angles[1])))
    return total


def slow_log_directions(coloring: Coloring, scale: float, strength: float, angle: float) -> float:
    """Sum of log m(theta) - (lambda(theta) - 2 p) |e|, both by quadrature, over all edges."""
    total = 0.0
    for a, b in coloring.edges:
        dx, dy = coloring.xy[b] - coloring.xy[a]
        direction = math.atan2(dy, dx)
        measure = line_measure(direction, strength, angle)
        total += math.log(measure) - (slow_rate(direction, scale, strength, angle) - 2.0 * scale) * math.hypot(dx, dy)
    return total


def line_measure(direction: float, strength: float, angle: float) -> float:
    """m(theta), whose mean over all directions is 1."""
    mean = quad(lambda theta: math.exp(strength * math.cos(4.0 * theta)), 0.0, math.pi)[0] / math.pi
    return math.exp(strength * math.cos(4.0 * (direction - angle))) / float(mean)


def slow_rate(direction: float, scale: float, strength: float, angle: float) -> float:
    """lambda(phi) = p int m(theta) |sin(theta - phi)| over all directions of lines."""
    mean = quad(lambda theta: math.exp(strength * math.cos(4.0 * theta)), 0.0, math.pi)[0] / math.pi
    crossed = quad(
        lambda theta: math.exp(strength * math.cos(4.0 * (theta + direction - angle))) * math.sin(theta), 0.0, math.pi
    )
    return scale * float(crossed[0]) / float(mean)


def read_cf(path: Path) -> Coloring:
    """Read a realisation of KvLS's program: ``W H``, ``N``, then ``id x y neighbour1 neighbour2 ...`` (0: none)."""
    lines = path.read_text().splitlines()
    width, height = map(float, lines[0].split())
    rows = [line.split() for line in lines[2 : 2 + int(lines[1])]]
    xy = np.array([[float(row[1]), float(row[2])] for row in rows])
    pairs = {tuple(sorted((int(row[0]) - 1, int(other) - 1))) for row in rows for other in row[3:5] if other != "0"}
    side = np.full(len(xy), INTERIOR, np.int8)
    for s, value in enumerate((0.0, width, height, 0.0)):
        side[xy[:, 1 - s % 2] == value] = s
    return Coloring(Window(0.0, 0.0, width, height), xy, side, np.array(sorted(pairs), np.int32), False)
