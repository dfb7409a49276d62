"""The occupied area as rings that other programs agree on."""

from __future__ import annotations

from typing import NamedTuple

import shapely
from shapely import MultiPolygon
from shapely.geometry.polygon import orient

from prf.coloring import Coloring, occupied_polygons


class Counts(NamedTuple):
    """Size of an area: polygons, holes in them, corners of all rings (the closing one counted once), square metres."""

    n_polygons: int
    n_holes: int
    n_vertices: int
    area: float


def oriented_polygons(coloring: Coloring) -> MultiPolygon:
    """Return the occupied area, outer rings counter-clockwise and holes clockwise, as RFC 7946 asks (section 3.1.6)."""
    return MultiPolygon([orient(polygon, 1.0) for polygon in occupied_polygons(coloring).geoms])


def counts(area: MultiPolygon) -> Counts:
    """Return the size of an area."""
    n_rings = sum(1 + len(polygon.interiors) for polygon in area.geoms)
    n_polygons = len(area.geoms)
    n_vertices = int(shapely.get_num_coordinates(area)) - n_rings
    return Counts(n_polygons, n_rings - n_polygons, n_vertices, float(area.area))
