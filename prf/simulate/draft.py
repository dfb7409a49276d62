"""A floor plan in the making: a solid block from which space is carved, and solid things put into that space."""

from __future__ import annotations

from typing import NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

OVERLAP = 0.02
"""Metres by which what touches overlaps, so that a union never hangs on rounding."""


class Box(NamedTuple):
    """An upright rectangle, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        """Extent in x."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """Extent in y."""
        return self.y1 - self.y0

    def grown(self, by: float) -> Box:
        """Return the box with all sides moved outwards."""
        return Box(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def polygon(self) -> BaseGeometry:
        """Return the box as a polygon."""
        return shapely.box(*self)


class Wall(NamedTuple):
    """A wall along x between a corridor and rooms; `room_side` is 1 if the rooms lie above it, -1 below."""

    x0: float
    y0: float
    x1: float
    y1: float
    room_side: int


def box_of(x0: float, y0: float, x1: float, y1: float) -> Box:
    """Return a box on whole tenths of a millimetre, so that plans are the same wherever they are drawn."""
    return Box(round(x0, 4), round(y0, 4), round(x1, 4), round(y1, 4))


class Draft:
    """What has been drawn so far.

    Parameters
    ----------
    building : Box
        Solid at first.

    Attributes
    ----------
    rooms : list of Box
    kept_clear : list of shapely.Polygon
        Where nothing may stand: before and behind doors, and round what stands already.
    """

    def __init__(self, building: Box) -> None:
        self.building = building
        self.rooms: list[Box] = []
        self.kept_clear: list[BaseGeometry] = []
        self._free: list[BaseGeometry] = []
        self._solid: list[BaseGeometry] = []

    def carve(self, box: Box) -> None:
        """Make the inside of a box free."""
        self._free.append(box.polygon())

    def add_room(self, box: Box) -> Box:
        """Carve a room, and return it."""
        self.rooms.append(box)
        self.carve(box)
        return box

    def add_solid(self, shape: BaseGeometry) -> None:
        """Put a thing into free space; it may reach into walls."""
        self._solid.append(shape)

    def keep_clear(self, shape: BaseGeometry) -> None:
        """Let nothing stand in `shape` from now on."""
        self.kept_clear.append(shape)

    def has_space(self, shape: BaseGeometry) -> bool:
        """Return whether a thing may stand there."""
        return not any(shape.intersects(other) for other in self.kept_clear)

    def occupied(self) -> BaseGeometry:
        """Return the walls of the building and all that stands in it."""
        walls = shapely.difference(self.building.polygon(), shapely.union_all(self._free))
        inside = shapely.intersection(shapely.union_all(self._solid), self.building.polygon())
        return shapely.union_all([walls, inside])
