"""Outlines of occupied ground as lines for CAD: with fewer vertices, and parted by how probable each piece is."""

from __future__ import annotations

from itertools import groupby
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from prf.kernels.score import query
from prf.model.coloring import Draws

OCCUPIED = "OCCUPIED"
"""Layer of outlines whose probability is not known: of one map alone."""
LAYERS = ((0.9, "WALL-90"), (0.5, "WALL-50"), (0.0, "WALL-BELOW-50"))
"""Least probability of a piece, and its layer."""
NEAR = 0.1
"""Metres from a piece, beside those by which it was simplified, within which a draw has a wall that is the same."""
APART = 0.25
"""Metres between the places of a piece that are looked at, at most."""
SIMPLIFIED = 0.05
"""Metres by which outlines for CAD may be off those of the map."""


class Outline(NamedTuple):
    """A line of a drawing: corners (n, 2) in metres, whether it is closed, and its layer."""

    xy: NDArray[np.float64]
    is_closed: bool
    layer: str


def simplified(area: MultiPolygon, tolerance: float) -> MultiPolygon:
    """Return polygons with fewer vertices, nowhere farther than `tolerance` metres off; holes and parts are kept."""
    if tolerance == 0.0:
        return area
    found = shapely.simplify(area, tolerance, preserve_topology=True)
    return found if isinstance(found, MultiPolygon) else MultiPolygon([found])


def outlines(area: MultiPolygon, draws: Draws | None, tolerance: float) -> list[Outline]:
    """Return the outlines of polygons, which were simplified by `tolerance` metres.

    With `draws` each ring is parted where the probability of its edges passes to another of :data:`LAYERS`.
    """
    rings = [ring for polygon in area.geoms for ring in (polygon.exterior, *polygon.interiors)]
    corners = [np.asarray(ring.coords)[:-1] for ring in rings]
    if draws is None or not corners:
        return [Outline(xy, True, OCCUPIED) for xy in corners]
    begin = np.concatenate(corners)
    end = np.concatenate([np.roll(xy, -1, axis=0) for xy in corners])
    layer = [layer_of(p) for p in edge_probability(draws, begin, end, NEAR + tolerance).tolist()]
    lines, first = [], 0
    for xy in corners:
        lines += _parted(xy, layer[first : first + len(xy)])
        first += len(xy)
    return lines


def layer_of(probability: float) -> str:
    """Return the layer of a piece of this probability."""
    return next(name for least, name in LAYERS if probability >= least)


def _parted(xy: NDArray[np.float64], layer: list[str]) -> list[Outline]:
    """Return a ring (n, 2), whose edge k, from corner k on, has a layer, as lines of one layer each."""
    if len(set(layer)) == 1:
        return [Outline(xy, True, layer[0])]
    start = next(k for k in range(len(layer)) if layer[k] != layer[k - 1])
    turned, layer = np.roll(xy, -start, axis=0), layer[start:] + layer[:start]
    lines, at = [], 0
    for name, edges in groupby(layer):
        n = len(list(edges))
        lines.append(Outline(np.take(turned, np.arange(at, at + n + 1), axis=0, mode="wrap"), False, name))
        at += n
    return lines


def edge_probability(
    draws: Draws, begin: NDArray[np.float64], end: NDArray[np.float64], near: float
) -> NDArray[np.float64]:
    """Return how probable the edges between places (n, 2) are: along them, the share of draws with a wall near.

    Near is a wall that meets the square of half side `near` metres round a place.
    """
    length = np.hypot(*(end - begin).T)
    n_places = np.maximum(1, np.ceil(length / APART)).astype(np.int64)
    edge = np.repeat(np.arange(len(begin)), n_places)
    part = (np.arange(len(edge)) - np.repeat(np.cumsum(n_places) - n_places, n_places) + 0.5) / n_places[edge]
    places = begin[edge] + part[:, None] * (end - begin)[edge]
    order = np.argsort(places[:, 0], kind="stable")
    marked = np.zeros((len(draws), len(places)), np.bool_)
    query.draws_mark_squares(np.ascontiguousarray(places[order]), near, draws.graphs, marked)
    share = np.empty(len(places))
    share[order] = marked.mean(axis=0)
    return np.asarray(np.bincount(edge, share, len(begin)) / n_places)
