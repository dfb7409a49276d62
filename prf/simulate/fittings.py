"""What a floor plan is made of: rooms carved from a block, doors in varied states, pillars, cupboards and tables."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

OVERLAP = 0.02  # metres by which what touches overlaps, so that a union never hangs on rounding
LEAF = 0.05  # thickness of a door's leaf, metres
JAMB = 0.1  # metres of wall that a door leaves at the end of its room, at least
BEFORE_A_DOOR = 1.3  # metres on both sides of a door that are kept clear
PASSAGE = 0.8  # metres left between things, so that a robot fits through
PILLARS_APART = 5.0


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
    """A building, solid at first, into which rooms, doors and furniture are drawn; `rng` draws all that varies."""

    def __init__(self, building: Box, door_width: float, furniture: bool, rng: np.random.Generator) -> None:
        self.building = building
        self.door_width = door_width  # metres
        self.furniture = furniture  # pillars are there anyway
        self.rng = rng
        self.rooms: list[Box] = []
        self._kept_clear: list[BaseGeometry] = []  # before and behind doors, and round furniture
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

    def occupied(self) -> BaseGeometry:
        """Return the walls of the building and all things in it, which may reach into walls."""
        walls = shapely.difference(self.building.polygon(), shapely.union_all(self._free))
        inside = shapely.intersection(shapely.union_all(self._solid), self.building.polygon())
        return shapely.union_all([walls, inside])

    def door(self, room: Box, wall: Wall) -> None:
        """Join a room to its corridor by a door that is open, and a wide one sometimes by a second that may be shut."""
        spare = room.width - self.door_width - 2.0 * JAMB
        x = room.x0 + JAMB + max(spare, 0.0) * float(self.rng.beta(0.5, 0.5))
        self._gap(x, wall)
        state = self.rng.random()
        if state < 0.75:
            self._leaf(x, room, wall, 90.0 if state < 0.35 else float(self.rng.uniform(60.0, 115.0)))
        far = room.x0 + JAMB if x > room.x0 + 0.5 * spare else room.x1 - JAMB - self.door_width
        if abs(far - x) > 2.0 * self.door_width and self.rng.random() < 0.4:
            self._gap(far, wall)
            if self.rng.random() < 0.6:
                self._shut(far, wall)
            else:
                self._leaf(far, room, wall, float(self.rng.uniform(15.0, 110.0)))

    def wide_door(self, room: Box, wall: Wall) -> None:
        """Join a hall to a corridor by an opening without leaf."""
        width = min(2.0 * self.door_width, room.width - 2.0 * JAMB)
        x = room.x0 + JAMB + (room.width - width - 2.0 * JAMB) * float(self.rng.uniform(0.2, 0.8))
        self._gap(x, wall, width)

    def exits(self, corridor: Box, outer_wall: float) -> None:
        """Put shut doors at the ends of a corridor: niches in the outer wall."""
        half = 0.5 * min(corridor.height - 2.0 * JAMB, 2.0 * self.door_width)
        middle = 0.5 * (corridor.y0 + corridor.y1)
        for x0, x1 in ((corridor.x0 - outer_wall, corridor.x0), (corridor.x1, corridor.x1 + outer_wall)):
            niche = outer_wall - 2.0 * LEAF
            low = x1 - niche if x1 == corridor.x0 else x0 - OVERLAP
            self.carve(box_of(low, middle - half, low + niche + OVERLAP, middle + half))

    def connect(self, left: Box, right: Box) -> None:
        """Join neighbouring rooms by a door of their own, now and then."""
        spare = left.height - self.door_width - 2.0 * JAMB
        if spare < 0.0 or self.rng.random() > 0.15:
            return
        y = left.y0 + JAMB + spare * float(self.rng.uniform(0.1, 0.9))
        self.carve(box_of(left.x1 - OVERLAP, y, right.x0 + OVERLAP, y + self.door_width))
        middle = 0.5 * (left.x1 + right.x0)
        self._kept_clear.append(
            shapely.box(middle - BEFORE_A_DOOR, y - LEAF, middle + BEFORE_A_DOOR, y + self.door_width + LEAF)
        )
        if self.rng.random() < 0.5:
            leaf = box_of(middle - 0.5 * LEAF, y - OVERLAP, middle + 0.5 * LEAF, y + self.door_width + OVERLAP)
            self._solid.append(leaf.polygon())

    def furnish(self, room: Box) -> None:
        """Put cupboards along the walls and a table into a room, where there is space."""
        if not self.furniture:
            return
        for _ in range(int(self.rng.integers(0, 4))):
            self._place(self._cupboard(room))
        if min(room.width, room.height) > 3.0 and self.rng.random() < 0.6:
            self._place(self._table(room), within=room.grown(-PASSAGE))

    def furnish_hall(self, hall: Box) -> None:
        """Put pillars into a hall, on a grid, and tables between them."""
        n_x, n_y = (max(0, round(length / PILLARS_APART) - 1) for length in (hall.width, hall.height))
        size = float(self.rng.uniform(0.4, 0.6))
        is_round = self.rng.random() < 0.5
        for i in range(n_x):
            for j in range(n_y):
                x = hall.x0 + hall.width * (i + 1) / (n_x + 1)
                y = hall.y0 + hall.height * (j + 1) / (n_y + 1)
                self._place(octagon(x, y, 0.5 * size) if is_round else _turned_box(x, y, size, size, 0.0))
        if self.furniture and min(hall.width, hall.height) > 3.0:
            for _ in range(int(hall.width * hall.height / 25.0)):
                self._place(self._table(hall), within=hall.grown(-PASSAGE))

    def _gap(self, x: float, wall: Wall, width: float | None = None) -> None:
        """Open a wall from `x` on, and keep both sides clear."""
        end = x + (self.door_width if width is None else width)
        gap = box_of(x, wall.y0 - OVERLAP, end, wall.y1 + OVERLAP)
        self.carve(gap)
        self._kept_clear.append(shapely.box(gap.x0 - 0.2, gap.y0 - BEFORE_A_DOOR, gap.x1 + 0.2, gap.y1 + BEFORE_A_DOOR))

    def _shut(self, x: float, wall: Wall) -> None:
        """Put a leaf into its frame, in the middle of the wall."""
        middle = 0.5 * (wall.y0 + wall.y1)
        leaf = box_of(x - OVERLAP, middle - 0.5 * LEAF, x + self.door_width + OVERLAP, middle + 0.5 * LEAF)
        self._solid.append(leaf.polygon())

    def _leaf(self, x: float, room: Box, wall: Wall, degrees: float) -> None:
        """Hang a leaf at the nearer side wall and open it into the room by an angle."""
        to_left, to_right = x - room.x0, room.x1 - (x + self.door_width)
        inwards = -1.0 if to_left > to_right else 1.0
        hinge = x + self.door_width if inwards < 0.0 else x
        behind = self.door_width * max(0.0, -math.cos(math.radians(degrees)))
        if behind > min(to_left, to_right) - JAMB:  # it would be in the side wall
            degrees = 90.0
        turn = math.radians(degrees)
        face = wall.y1 if wall.room_side > 0 else wall.y0
        # The hinge lies in the wall, so that leaf and wall are one thing.
        start = (hinge - inwards * 1.5 * OVERLAP, face - wall.room_side * 1.5 * OVERLAP)
        along = (inwards * math.cos(turn), wall.room_side * math.sin(turn))
        end = (start[0] + self.door_width * along[0], start[1] + self.door_width * along[1])
        self._solid.append(shapely.LineString([start, end]).buffer(0.5 * LEAF, cap_style="flat"))

    def _cupboard(self, room: Box) -> BaseGeometry:
        """Return a cupboard against one of the walls."""
        side = int(self.rng.integers(4))
        length, depth = float(self.rng.uniform(0.7, 2.0)), float(self.rng.uniform(0.35, 0.6))
        along = room.width if side % 2 == 0 else room.height
        length = min(length, 0.5 * along)
        start = float(self.rng.uniform(0.0, along - length))
        if side % 2 == 0:
            y0, y1 = (room.y0 - OVERLAP, room.y0 + depth) if side == 0 else (room.y1 - depth, room.y1 + OVERLAP)
            return box_of(room.x0 + start, y0, room.x0 + start + length, y1).polygon()
        x0, x1 = (room.x0 - OVERLAP, room.x0 + depth) if side == 3 else (room.x1 - depth, room.x1 + OVERLAP)
        return box_of(x0, room.y0 + start, x1, room.y0 + start + length).polygon()

    def _table(self, room: Box) -> BaseGeometry:
        """Return a table somewhere in a room, turned at random, or a round one."""
        x, y = (float(v) for v in self.rng.uniform((room.x0, room.y0), (room.x1, room.y1)))
        along, across = float(self.rng.uniform(1.2, 1.8)), float(self.rng.uniform(0.7, 0.9))
        if self.rng.random() < 0.25:
            return octagon(x, y, 0.6 * across)
        return _turned_box(x, y, along, across, float(self.rng.choice((0.0, 90.0, self.rng.uniform(0.0, 180.0)))))

    def _place(self, thing: BaseGeometry, within: Box | None = None) -> None:
        """Put a thing down if there is space for it, and let others keep their distance."""
        is_clear = not any(thing.intersects(other) for other in self._kept_clear)
        if is_clear and (within is None or within.polygon().contains(thing)):
            self._solid.append(thing)
            self._kept_clear.append(thing.buffer(PASSAGE, quad_segs=2))


def octagon(x: float, y: float, radius: float) -> BaseGeometry:
    """Return an upright octagon: what is round, as walls."""
    turns = math.pi / 8.0 + math.pi / 4.0 * np.arange(8)
    corners = np.column_stack((x + radius * np.cos(turns), y + radius * np.sin(turns)))
    return shapely.Polygon(np.round(corners, 4))


def _turned_box(x: float, y: float, along: float, across: float, degrees: float) -> BaseGeometry:
    """Return a rectangle round a point, turned."""
    upright = shapely.box(x - 0.5 * along, y - 0.5 * across, x + 0.5 * along, y + 0.5 * across)
    turned = affinity.rotate(upright, degrees)
    return shapely.Polygon(np.round(shapely.get_coordinates(turned), 4))
