"""The size of an occupied area."""

from __future__ import annotations

from typing import NamedTuple

import shapely
from shapely import MultiPolygon


class Counts(NamedTuple):
    """Size of an area: polygons, holes in them, corners of all rings (the closing one counted once), square metres."""

    n_polygons: int
    n_holes: int
    n_vertices: int
    area: float


def counts(area: MultiPolygon) -> Counts:
    """Return the size of an area."""
    n_rings = sum(1 + len(polygon.interiors) for polygon in area.geoms)
    n_polygons = len(area.geoms)
    n_vertices = int(shapely.get_num_coordinates(area)) - n_rings
    return Counts(n_polygons, n_rings - n_polygons, n_vertices, float(area.area))
