"""The region that rectangles cover together as a map: quick where no two of their sides nearly touch.

A corner, or a crossing of two sides, is a vertex of the outline unless a further rectangle covers it; along a side
these vertices bound in turn what others cover and what they do not. It takes milliseconds where a union of polygons
takes a hundred, and every draw of a chain of walls needs one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring.graph import Coloring, black_at
from prf.model.window import INTERIOR, Window

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CLOSE = 1e-8
"""Metres between two vertices, or a corner and a side, below which rounding may decide what lies where."""
PARALLEL = 1e-6
"""Sine of the angle of two sides that cross, below which the same holds of the place where they do."""


class Sides(NamedTuple):
    """Sides of rectangles, four of each, one after the other."""

    start: Floats  # (n, 2)
    along: Floats  # (n, 2) from start to end


def outline_of_rectangles(corners: Floats, window: Window) -> Coloring | None:
    """Return the map that is black on rectangles; None where rounding may decide.

    That is where vertices nearly touch what they are no part of, and where a corner does not lie inside the window.
    `corners`: (n, 4, 2), metres, each rectangle counter-clockwise.
    """
    if not window.contains(corners.reshape(-1, 2), strictly=True).all():
        return None
    one, other = _neighbours(corners)
    sides = Sides(corners.reshape(-1, 2), (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2))
    crossings = _crossings(sides, one, other)
    if crossings is None:
        return None
    at, first, second, t, u = crossings
    n = len(sides.start)
    owner = np.concatenate([np.arange(n) // 4, first // 4])
    places = np.concatenate([sides.start, at])
    covered = _covered(corners, places, owner, np.append(np.full(n, -1), second // 4), one, other)
    if covered is None:
        return None
    side = np.arange(n)
    before = side - side % 4 + (side - 1) % 4
    found = _paired(
        np.concatenate([side, before, first, second]),
        np.concatenate([np.zeros(n), np.ones(n), t, u]),
        np.concatenate([side, side, n + np.arange(len(at)), n + np.arange(len(at))]),
        ~covered,
        np.hypot(*sides.along.T),
    )
    if found is None:
        return None
    kept, edges = np.unique(found, return_inverse=True)
    xy = np.ascontiguousarray(places[kept])
    ends: NDArray[np.int32] = edges.reshape(-1, 2).astype(np.int32)
    coloring = Coloring(window, xy, np.full(len(xy), INTERIOR, np.int8), ends, False)
    return coloring._replace(anchor_black=bool(black_at(coloring, np.array([window[:2]]))[0]))


def _neighbours(corners: Floats) -> tuple[Indices, Indices]:
    """Return pairs of different rectangles whose boxes meet, both ways round, in the order of the first."""
    low, high = corners.min(axis=1) - CLOSE, corners.max(axis=1) + CLOSE
    order = np.argsort(low[:, 0])
    low, high, place = low[order], high[order], np.arange(len(order))
    i, j = _ranges(place + 1, np.searchsorted(low[:, 0], high[:, 0], side="right"))
    meet = (low[i, 1] <= high[j, 1]) & (high[i, 1] >= low[j, 1])
    i, j = order[i[meet]], order[j[meet]]
    one, other = np.concatenate([i, j]), np.concatenate([j, i])
    by_first = np.argsort(one, kind="stable")
    return one[by_first], other[by_first]


def _ranges(begin: Indices, end: Indices) -> tuple[Indices, Indices]:
    """Return each index of (n,) ranges with the number of its range."""
    counts = end - begin
    number = np.repeat(np.arange(len(counts)), counts)
    return number, np.arange(len(number)) + np.repeat(begin - (np.cumsum(counts) - counts), counts)


def _crossings(sides: Sides, one: Indices, other: Indices) -> tuple[Floats, Indices, Indices, Floats, Floats] | None:
    """Return where sides of neighbours cross, (n, 2), the two sides, and the shares of their lengths there."""
    is_once = one < other
    a, b = np.divmod(np.arange(16), 4)
    first = (4 * one[is_once][:, None] + a).ravel()
    second = (4 * other[is_once][:, None] + b).ravel()
    d, e = sides.along[first], sides.along[second]
    gap = sides.start[second] - sides.start[first]
    cross = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (gap[:, 0] * e[:, 1] - gap[:, 1] * e[:, 0]) / cross
        u = (gap[:, 0] * d[:, 1] - gap[:, 1] * d[:, 0]) / cross
    meet = (t > 0.0) & (t < 1.0) & (u > 0.0) & (u < 1.0)
    first, second, t, u = first[meet], second[meet], t[meet], u[meet]
    sine = np.abs(cross[meet]) / (np.hypot(*d[meet].T) * np.hypot(*e[meet].T))
    if (sine < PARALLEL).any():
        return None
    return sides.start[first] + t[:, None] * sides.along[first], first, second, t, u


def _covered(
    corners: Floats, places: Floats, owner: Indices, also: Indices, one: Indices, other: Indices
) -> NDArray[np.bool_] | None:
    """Return which places (m, 2) rectangles cover other than the one or two whose sides they lie on."""
    begin = np.searchsorted(one, np.arange(len(corners) + 1))
    place, number = _ranges(begin[owner], begin[owner + 1])
    rectangle = other[number]
    is_other = rectangle != also[place]
    place, rectangle = place[is_other], rectangle[is_other]
    middle = corners.mean(axis=1)
    axes = np.stack([corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]], axis=1)
    half = 0.5 * np.hypot(axes[:, :, 0], axes[:, :, 1])
    away = np.abs(np.einsum("nij,nj->ni", axes[rectangle], places[place] - middle[rectangle])) / (2.0 * half[rectangle])
    outside = (away - half[rectangle]).max(axis=1)
    if (np.abs(outside) < CLOSE).any():
        return None
    covered = np.zeros(len(places), np.bool_)
    covered[place[outside < 0.0]] = True
    return covered


def _paired(
    side: Indices, share: Floats, vertex: Indices, is_vertex: NDArray[np.bool_], length: Floats
) -> Indices | None:
    """Return the edges (n, 2) between vertices that follow each other along sides, from even to odd ones."""
    kept = is_vertex[vertex]
    side, share, vertex = side[kept], share[kept], vertex[kept]
    order = np.lexsort((share, side))
    side, share, vertex = side[order], share[order], vertex[order]
    same = side[1:] == side[:-1]
    if ((np.diff(share) * length[side[1:]] < CLOSE) & same).any():
        return None
    first, second = np.arange(0, len(side), 2), np.arange(1, len(side), 2)
    if len(side) % 2 or (side[first] != side[second]).any():
        return None
    return np.stack([vertex[first], vertex[second]], axis=1)
