"""Generated floor plans: corridors with rooms on both sides, doors in varied states, halls with pillars, furniture."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from prf.model.window import Window
from prf.shell.errors import ConfigError
from prf.simulate.world import World

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


ROOM = 4.0  # usual width of a room, metres; rooms vary by about 0.6 to 1.5 times this
DOOR, CORRIDOR = 0.9, 2.0  # clear widths, metres
OUTER_WALL = 0.3
CORRIDOR_WALL = 0.2
PARTITIONS = (0.1, 0.2)  # metres; the walls between rooms vary
MARGIN = 0.5  # metres of free space round the building: less than a robot needs, so that no path leads outside
DEPTH_OF_ROOM = 1.25  # depth of a room from its corridor, over its usual width
MIN_DEPTH = 2.0
CROSSING = 30.0  # metres of building for each corridor that crosses the others
HALL_SHARE = 0.25


def office(width: float, height: float, rng: np.random.Generator, furniture: bool = True) -> World:
    """Return a floor of an office; every room can be reached through doors that are wide open.

    `width`, `height`: outside of the building, metres. Its lower left corner is the origin; the window reaches `MARGIN`
    beyond it. `furniture`: whether there are cupboards along the walls and tables in the rooms.
    """
    window = Window.checked(-MARGIN, -MARGIN, width + MARGIN, height + MARGIN)
    if min(width, height) < 3.0:
        raise ConfigError(f"size {width:g} x {height:g}: an office is at least 3 m wide and high")
    return World.from_polygons(draft_office(width, height, rng, furniture).occupied(), window)


def draft_office(width: float, height: float, rng: np.random.Generator, furniture: bool = True) -> Draft:
    """Return the draft of a floor, which knows rooms and doors besides what is occupied."""
    draft = Draft(Box(0.0, 0.0, width, height), DOOR, furniture, rng)
    inside = Box(OUTER_WALL, OUTER_WALL, width - OUTER_WALL, height - OUTER_WALL)
    corridors = _corridors(inside, rng)
    if not corridors:
        draft.furnish_hall(draft.add_room(inside))
        return draft
    for corridor in corridors:
        draft.carve(corridor)
        draft.exits(corridor, OUTER_WALL)
    crossings = _crossings(width, corridors, rng)
    for crossing in crossings:
        draft.carve(crossing)
    for row in _outer_rows(inside, corridors):
        _fill_row(*row, draft, rng)
    for lower, upper in itertools.pairwise(corridors):
        _fill_band(lower, upper, crossings, draft, rng)
    return draft


def _corridors(inside: Box, rng: np.random.Generator) -> list[Box]:
    """Return the long corridors from south to north; none if the building is too small for one with rooms."""
    depth = DEPTH_OF_ROOM * ROOM
    wall = CORRIDOR_WALL
    n = max(1, round(inside.height / (2.0 * depth + CORRIDOR + 3.0 * wall)))
    spare = inside.height - n * (CORRIDOR + 2.0 * wall) - (n - 1) * wall
    if spare / (2 * n) < MIN_DEPTH:
        if inside.height - CORRIDOR - wall < MIN_DEPTH:
            return []
        return [box_of(inside.x0, inside.y1 - CORRIDOR, inside.x1, inside.y1)]
    weights = rng.uniform(0.85, 1.15, 2 * n)
    depths = np.maximum(spare * weights / weights.sum(), MIN_DEPTH)
    depths *= spare / depths.sum()
    corridors, y = [], inside.y0
    for below, above in depths.reshape(-1, 2):
        low = y + below + wall
        corridors.append(box_of(inside.x0, low, inside.x1, low + CORRIDOR))
        y = low + CORRIDOR + wall + above + wall
    return corridors


def _crossings(width: float, corridors: list[Box], rng: np.random.Generator) -> list[Box]:
    """Return corridors that join the others, so that there are loops to drive."""
    if len(corridors) < 2:
        return []
    south, north = corridors[0], corridors[-1]
    n = max(1, round(width / CROSSING))
    shift = rng.uniform(-0.2, 0.2, n)
    middles = width * (np.arange(n) + 0.5 + shift) / n
    half = 0.5 * min(CORRIDOR, south.width)
    middles = np.clip(middles, south.x0 + half, south.x1 - half)
    # What is left beside a crossing is a block of rooms, or nothing thinner than a wall.
    middles = np.where(middles - half - south.x0 < OUTER_WALL, south.x0 + half, middles)
    middles = np.where(south.x1 - middles - half < OUTER_WALL, south.x1 - half, middles)
    return [box_of(x - half, south.y0, x + half, north.y1) for x in middles.tolist()]


def _outer_rows(inside: Box, corridors: list[Box]) -> list[tuple[Box, Wall]]:
    """Return the rows of rooms along the south and, if there is space, the north, each with its inner wall."""
    south, north = corridors[0], corridors[-1]
    wall = CORRIDOR_WALL
    below = Box(inside.x0, inside.y0, inside.x1, south.y0 - wall)
    above = Box(inside.x0, north.y1 + wall, inside.x1, inside.y1)
    rows = [(below, Wall(below.x0, south.y0 - wall, below.x1, south.y0, room_side=-1))]
    if above.height >= 0.5 * MIN_DEPTH:
        rows.append((above, Wall(above.x0, north.y1, above.x1, north.y1 + wall, room_side=1)))
    return rows


def _fill_band(lower: Box, upper: Box, crossings: list[Box], draft: Draft, rng: np.random.Generator) -> None:
    """Fill what lies between two corridors: blocks of two rows back to back, or halls."""
    wall = CORRIDOR_WALL
    y0, y1 = lower.y1 + wall, upper.y0 - wall
    middle = 0.5 * (y0 + y1)
    ends = [lower.x0, *(end for crossing in crossings for end in (crossing.x0 - wall, crossing.x1 + wall)), lower.x1]
    blocks = [block for block in zip(ends[::2], ends[1::2], strict=True) if block[1] - block[0] > 1.5 * DOOR]
    certain = int(rng.integers(max(1, len(blocks))))
    for number, (x0, x1) in enumerate(blocks):
        south = Wall(x0, lower.y1, x1, y0, room_side=1)
        north = Wall(x0, y1, x1, upper.y0, room_side=-1)
        if number == certain or rng.random() < HALL_SHARE:
            cut = _hall_end(x0, x1, rng)
            hall = draft.add_room(box_of(x0, y0, cut, y1))
            draft.wide_door(hall, south)
            draft.wide_door(hall, north)
            draft.furnish_hall(hall)
            x0 = cut + wall
        if x1 - x0 > 1.5 * DOOR:
            _fill_row(box_of(x0, y0, x1, middle - 0.5 * wall), south, draft, rng)
            _fill_row(box_of(x0, middle + 0.5 * wall, x1, y1), north, draft, rng)


def _hall_end(x0: float, x1: float, rng: np.random.Generator) -> float:
    """Return where a hall that begins at `x0` ends: three rooms on, or with the block."""
    end = x0 + rng.uniform(2.5, 4.0) * ROOM
    return x1 if x1 - end < ROOM else end


def _fill_row(place: Box, corridor_wall: Wall, draft: Draft, rng: np.random.Generator) -> None:
    """Divide a row into rooms, each with a door to the corridor."""
    n = max(1, round(place.width / ROOM))
    weights = rng.uniform(0.7, 1.5, n)
    partitions = np.round(rng.uniform(*PARTITIONS, n - 1), 2)
    widths = (place.width - partitions.sum()) * weights / weights.sum()
    x, last = place.x0, None
    for number, width in enumerate(widths.tolist()):
        end = place.x1 if number == n - 1 else x + width
        room = draft.add_room(box_of(x, place.y0, end, place.y1))
        draft.door(room, corridor_wall)
        if last is not None:
            draft.connect(last, room)
        if number < n - 1:
            x = end + float(partitions[number])
        last = room
    for room in draft.rooms[-n:]:
        draft.furnish(room)
