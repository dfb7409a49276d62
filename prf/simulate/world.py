"""`World`: the truth of a simulation, occupied area in a window, and its walls as a sensor meets them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.coloring.polygons import turning_corners
from prf.model.window import SIDES, Window

Floats = NDArray[np.float64]

STRAIGHT = 1e-9  # metres that a vertex may stick out of the line of its neighbours before it counts as a corner


@dataclass(frozen=True, eq=False)
class World:
    """What is occupied, and its boundary."""

    window: Window  # where the world is known. Its border is not a wall: nothing beyond it is ever met
    occupied: MultiPolygon  # occupied area inside the window, holes kept, in metres
    # (n, 4) ``x1 y1 x2 y2`` in metres, free space on the left of the way from 1 to 2; ring by ring, the end of a wall
    # is the beginning of the next to the last bit, but where the window cuts a ring. Neighbours are never in line
    walls: Floats

    @classmethod
    def from_polygons(cls, occupied: BaseGeometry, window: Window) -> World:
        """Return the world that is occupied on `occupied`, clipped to the window."""
        return cls.from_coloring(from_polygons(without_straight(occupied), window))

    @classmethod
    def from_coloring(cls, coloring: Coloring) -> World:
        """Return the world that is occupied where a coloring is black."""
        occupied = occupied_polygons(coloring)
        return cls(coloring.window, occupied, _walls(occupied, coloring.window))

    def coloring(self) -> Coloring:
        """Return the world as a coloring of its window."""
        if (
            self.occupied.is_empty or len(self.walls) == 0
        ):  # no ring determines which of the two colours fills the window
            return Coloring.empty(self.window, not self.occupied.is_empty)
        return from_polygons(self.occupied, self.window)

    def free_at(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which points (n, 2) are free: inside the window, neither in occupied area nor on a wall."""
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        shapely.prepare(self.occupied)
        occupied = shapely.intersects_xy(self.occupied, points)
        free: NDArray[np.bool_] = self.window.contains(points) & ~occupied
        return free


def without_straight(region: BaseGeometry) -> MultiPolygon:
    """Return a region whose rings have no vertex at which nothing turns: unions leave them in the middle of walls.

    `region`: whatever has no area is left out.
    """
    cleaned = []
    for part in shapely.get_parts(region):
        rings = [_bent(ring) for ring in shapely.get_rings(part)] if isinstance(part, Polygon) else []
        if rings and len(rings[0]) > 2:
            cleaned.append(Polygon(rings[0], [ring for ring in rings[1:] if len(ring) > 2]))
    return MultiPolygon(cleaned)


def _bent(ring: BaseGeometry) -> Floats:
    """Return the corners (n, 2) of a ring, the first one not repeated."""
    return turning_corners(shapely.get_coordinates(ring)[:-1], STRAIGHT)


def _walls(occupied: MultiPolygon, window: Window) -> Floats:
    """Return the sides of all rings, outlines clockwise and holes counter-clockwise, without those on the border."""
    turned = [orient(polygon, sign=-1.0) for polygon in occupied.geoms]
    rings = shapely.get_rings(np.array(turned, dtype=object))
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    follows = ring[:-1] == ring[1:]
    walls = np.hstack([xy[:-1][follows], xy[1:][follows]])
    along = np.zeros(len(walls), dtype=np.bool_)
    for side in SIDES:
        at = window.side_coordinate(side)
        along |= (walls[:, 1 - side % 2] == at) & (walls[:, 3 - side % 2] == at)
    return np.ascontiguousarray(walls[~along])
