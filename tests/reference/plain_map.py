"""A coloring as sets of points and of pairs of points, as the slow reference of the moves reads it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring
from prf.model.window import INTERIOR, Window

Point = tuple[float, float]
Edge = frozenset[Point]
Edges = frozenset[Edge]


class PlainMap(NamedTuple):
    """Vertices with their sides, edges as unordered pairs of vertices, and the colour of the anchor."""

    window: Window
    side: dict[Point, int]
    edges: Edges
    anchor_black: bool

    def interior(self) -> list[Point]:
        return [v for v in self.side if self.side[v] == INTERIOR]

    def boundary(self) -> list[Point]:
        return [v for v in self.side if self.side[v] != INTERIOR]

    def edges_at(self, v: Point) -> list[Edge]:
        return [edge for edge in self.edges if v in edge]

    def neighbors(self, v: Point) -> list[Point]:
        return [other(edge, v) for edge in self.edges_at(v)]

    def same_side(self, a: Point, b: Point) -> bool:
        return self.side[a] != INTERIOR and self.side[a] == self.side[b]


def plain_map(coloring: Coloring) -> PlainMap:
    points = [(float(x), float(y)) for x, y in coloring.xy]
    edges = frozenset(frozenset((points[a], points[b])) for a, b in coloring.edges)
    sides = {point: int(side) for point, side in zip(points, coloring.side, strict=True)}
    if len(sides) != len(points) or len(edges) != len(coloring.edges):
        raise ValueError("two vertices at one place, or a repeated edge")
    return PlainMap(coloring.window, sides, edges, bool(coloring.anchor_black))


def other(edge: Edge, v: Point) -> Point:
    (u,) = edge - {v}
    return u


def closed(*points: Point) -> Edges:
    """Edges of the closed loop through the points."""
    return frozenset(frozenset(pair) for pair in zip(points, (*points[1:], points[0]), strict=True))


def chain(*points: Point) -> Edges:
    """Edges of the open chain through the points."""
    return frozenset(frozenset(pair) for pair in itertools.pairwise(points))


def corner_between(window: Window, s: int, t: int) -> Point | None:
    """The corner in which the sides s and t meet, if they do."""
    if (s - t) % 2 == 0:
        return None
    horizontal, vertical = (s, t) if s % 2 == 0 else (t, s)
    return window.side_coordinate(vertical), window.side_coordinate(horizontal)


def cells_passed(grid: Grid, a: Point, b: Point) -> frozenset[tuple[int, int]]:
    """Cells (ix, iy) with which the segment ab has more than a point in common: clipped against every square."""
    ix, iy = np.meshgrid(np.arange(grid.nx), np.arange(grid.ny))
    low_x, low_y = grid.x0 + ix * grid.cell, grid.y0 + iy * grid.cell
    passed = passes(a, b, (low_x, low_y), (low_x + grid.cell, low_y + grid.cell))
    return frozenset(zip(ix[passed].tolist(), iy[passed].tolist(), strict=True))


def passes(a: Point, b: Point, lows: tuple[ArrayLike, ArrayLike], highs: tuple[ArrayLike, ArrayLike]) -> NDArray:
    """Whether the segment ab has more than a point in common with each of the rectangles from `lows` to `highs`."""
    shape = np.shape(lows[0])
    enter, leave = np.zeros(shape), np.ones(shape)
    for start, end, low, high in zip(a, b, lows, highs, strict=True):
        if start == end:
            leave = np.where((low < start) & (start < high), leave, -1.0)
        else:
            first, second = (low - start) / (end - start), (high - start) / (end - start)
            enter = np.maximum(enter, np.minimum(first, second))
            leave = np.minimum(leave, np.maximum(first, second))
    return enter < leave


def sharing_cells(edges: Iterable[Edge], grid: Grid) -> dict[Edge, list[Edge]]:
    """N: for each edge those that pass through a cell that it passes through and share no vertex with it."""
    cells = {edge: cells_passed(grid, *sorted(edge)) for edge in edges}
    return {e: [f for f in cells if not e & f and cells[e] & cells[f]] for e in cells}


def round_the_middle(edges: Iterable[Edge], grid: Grid, jamb: Edge) -> list[Edge]:
    """M: the edges that share no vertex with the jamb and pass through the 7 x 7 cells round the cell of its middle."""
    a, b = jamb
    return in_block(edges, grid, jamb, (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])), 3)


def round_the_cut(
    edges: Iterable[Edge], grid: Grid, face: tuple[Point, Point], corners: tuple[Point, Point]
) -> list[Edge]:
    """O: those that share no vertex with the face and pass through the 3 x 3 cells round the middle of the cut."""
    a, b = face
    share = 0.5 * sum(foot_and_offset(v, a, b)[0] for v in corners)
    middle = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
    return in_block(edges, grid, frozenset(face), middle, 1)


def round_the_point(edges: Iterable[Edge], grid: Grid, v: Point) -> list[Edge]:
    """Edges that pass through the 5 x 5 cells round that of a point."""
    return in_block(edges, grid, frozenset(), v, 2)


def nearest_side(window: Window, u: Point, v: Point, limit: float) -> int | None:
    """The side that lies nearest to the middle of uv, if it is nearer than `limit`."""
    middle = (0.5 * (u[0] + v[0]), 0.5 * (u[1] + v[1]))
    distances = [abs(middle[(side + 1) % 2] - window.side_coordinate(side)) for side in range(4)]
    return distances.index(min(distances)) if min(distances) < limit else None


def in_block(edges: Iterable[Edge], grid: Grid, of: Edge, middle: Point, radius: int) -> list[Edge]:
    """The edges that share no vertex with `of` and pass through the cells round that of `middle`."""
    lows, highs = [], []
    for place, origin, n in ((middle[0], grid.x0, grid.nx), (middle[1], grid.y0, grid.ny)):
        cell = math.floor((place - origin) / grid.cell)
        lows.append(origin + max(cell - radius, 0) * grid.cell)
        highs.append(origin + min(cell + radius + 1, n) * grid.cell)
    return [edge for edge in edges if not edge & of and passes(*sorted(edge), tuple(lows), tuple(highs))]


def anchor_changes(x: PlainMap, y: PlainMap) -> bool:
    """Whether the anchor lies inside the loop of the edges that x and y do not share, closed along the border.

    Parity of the crossings of a slanted segment from the anchor to a place outside the window.
    """
    loop = [sorted(edge) for edge in x.edges ^ y.edges]
    ends = [v for v in x.side.keys() ^ y.side.keys() if {**x.side, **y.side}[v] != INTERIOR]
    if ends:
        a, b = ends
        corner = corner_between(x.window, {**x.side, **y.side}[a], {**x.side, **y.side}[b])
        loop += [[a, b]] if corner is None else [[a, corner], [corner, b]]
    far = (x.window.x_max + 1.7 * x.window.width, x.window.y_max + 0.3 * x.window.height)
    return sum(_cross(x.window.centre, far, c, d) for c, d in loop) % 2 == 1


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _left(a, b, c) != _left(a, b, d) and _left(c, d, a) != _left(c, d, b)


def _left(a: Point, b: Point, c: Point) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) > (b[1] - a[1]) * (c[0] - a[0])


def foot_and_offset(v: Point, u: Point, w: Point) -> tuple[float, float]:
    """Foot of v on the line uw, as a share of uw, and the distance of v from that line, positive on its left."""
    length = math.dist(u, w)
    along = ((v[0] - u[0]) * (w[0] - u[0]) + (v[1] - u[1]) * (w[1] - u[1])) / length**2
    across = ((w[0] - u[0]) * (v[1] - u[1]) - (w[1] - u[1]) * (v[0] - u[0])) / length
    return along, across
