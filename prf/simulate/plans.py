"""Generated floor plans: corridors with rooms on both sides, doors in varied states, halls with pillars."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from prf.shell.errors import ConfigError
from prf.simulate.fittings import Box, Draft, Fitter, Wall, box_of
from prf.simulate.world import World
from prf.window import Window

OUTER_WALL = 0.3
CORRIDOR_WALL = 0.2
PARTITIONS = (0.1, 0.2)
"""Metres; the walls between rooms vary."""
MARGIN = 0.5
"""Metres of free space round the building: less than a robot needs, so that no path leads outside."""
DEPTH_OF_ROOM = 1.25
"""Depth of a room from its corridor, over its usual width."""
MIN_DEPTH = 2.0
CROSSING = 30.0
"""Metres of building for each corridor that crosses the others."""
HALL_SHARE = 0.25


@dataclass(frozen=True)
class OfficePlan:
    """Size and style of an office floor, in metres.

    Attributes
    ----------
    width, height : float
        Outside of the building; by default about that of a wing.
    room : float
        Usual width of a room; rooms vary by about 0.6 to 1.5 times this.
    door : float
        Clear width of a door.
    corridor : float
        Width of a corridor.
    furniture : bool
        Cupboards along the walls and tables in the rooms.
    """

    width: float = 60.0
    height: float = 40.0
    room: float = 4.0
    door: float = 0.9
    corridor: float = 2.0
    furniture: bool = True

    def __post_init__(self) -> None:
        """Refuse sizes of which no building can be made."""
        for name in ("width", "height", "room", "door", "corridor"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"{name} {value}: must be a positive number of metres")
        if self.door < 0.7:
            raise ConfigError(f"door {self.door:g}: a robot needs at least 0.7 m")
        if self.room < 2.2 * self.door:
            raise ConfigError(f"room {self.room:g}: must be at least 2.2 times the door's width, {2.2 * self.door:.3g}")
        if self.corridor < 1.0:
            raise ConfigError(f"corridor {self.corridor:g}: must be at least 1 m wide")
        if min(self.width, self.height) < 3.0 or self.width < self.door + 1.5:
            raise ConfigError(f"size {self.width:g} x {self.height:g}: at least 3 m, and 1.5 m wider than a door")


class Row(NamedTuple):
    """A row of rooms: where, and the wall towards its corridor."""

    place: Box
    corridor_wall: Wall


def office(plan: OfficePlan, rng: np.random.Generator) -> World:
    """Return a floor of an office; every room can be reached through doors that are wide open.

    Returns
    -------
    World
        Its origin is the lower left outer corner; the window reaches `MARGIN` beyond the building.
    """
    window = Window(-MARGIN, -MARGIN, plan.width + MARGIN, plan.height + MARGIN)
    return World.from_polygons(draft_office(plan, rng).occupied(), window)


def draft_office(plan: OfficePlan, rng: np.random.Generator) -> Draft:
    """Return the draft of a floor, which knows rooms and doors besides what is occupied."""
    draft = Draft(Box(0.0, 0.0, plan.width, plan.height))
    fitter = Fitter(draft, plan.door, plan.furniture, rng)
    inside = Box(OUTER_WALL, OUTER_WALL, plan.width - OUTER_WALL, plan.height - OUTER_WALL)
    corridors = _corridors(plan, inside, rng)
    if not corridors:
        fitter.furnish_hall(draft.add_room(inside))
        return draft
    for corridor in corridors:
        draft.carve(corridor)
        fitter.exits(corridor, OUTER_WALL)
    crossings = _crossings(plan, corridors, rng)
    for crossing in crossings:
        draft.carve(crossing)
    for row in _outer_rows(inside, corridors):
        _fill_row(row, plan, fitter, rng)
    for lower, upper in itertools.pairwise(corridors):
        _fill_band(lower, upper, crossings, plan, fitter, rng)
    return draft


def _corridors(plan: OfficePlan, inside: Box, rng: np.random.Generator) -> list[Box]:
    """Return the long corridors from south to north; none if the building is too small for one with rooms."""
    depth = DEPTH_OF_ROOM * plan.room
    wall = CORRIDOR_WALL
    n = max(1, round(inside.height / (2.0 * depth + plan.corridor + 3.0 * wall)))
    spare = inside.height - n * (plan.corridor + 2.0 * wall) - (n - 1) * wall
    if spare / (2 * n) < MIN_DEPTH:
        if inside.height - plan.corridor - wall < MIN_DEPTH:
            return []
        return [box_of(inside.x0, inside.y1 - plan.corridor, inside.x1, inside.y1)]
    weights = rng.uniform(0.85, 1.15, 2 * n)
    depths = np.maximum(spare * weights / weights.sum(), MIN_DEPTH)
    depths *= spare / depths.sum()
    corridors, y = [], inside.y0
    for below, above in depths.reshape(-1, 2):
        low = y + below + wall
        corridors.append(box_of(inside.x0, low, inside.x1, low + plan.corridor))
        y = low + plan.corridor + wall + above + wall
    return corridors


def _crossings(plan: OfficePlan, corridors: list[Box], rng: np.random.Generator) -> list[Box]:
    """Return corridors that join the others, so that there are loops to drive."""
    if len(corridors) < 2:
        return []
    south, north = corridors[0], corridors[-1]
    n = max(1, round(plan.width / CROSSING))
    shift = rng.uniform(-0.2, 0.2, n)
    middles = plan.width * (np.arange(n) + 0.5 + shift) / n
    half = 0.5 * min(plan.corridor, south.width)
    middles = np.clip(middles, south.x0 + half, south.x1 - half)
    # What is left beside a crossing is a block of rooms, or nothing thinner than a wall.
    middles = np.where(middles - half - south.x0 < OUTER_WALL, south.x0 + half, middles)
    middles = np.where(south.x1 - middles - half < OUTER_WALL, south.x1 - half, middles)
    return [box_of(x - half, south.y0, x + half, north.y1) for x in middles.tolist()]


def _outer_rows(inside: Box, corridors: list[Box]) -> list[Row]:
    """Return the rows of rooms along the south and the north side, the latter if there is space for one."""
    south, north = corridors[0], corridors[-1]
    wall = CORRIDOR_WALL
    below = Box(inside.x0, inside.y0, inside.x1, south.y0 - wall)
    above = Box(inside.x0, north.y1 + wall, inside.x1, inside.y1)
    rows = [Row(below, Wall(below.x0, south.y0 - wall, below.x1, south.y0, room_side=-1))]
    if above.height >= 0.5 * MIN_DEPTH:
        rows.append(Row(above, Wall(above.x0, north.y1, above.x1, north.y1 + wall, room_side=1)))
    return rows


def _fill_band(
    lower: Box, upper: Box, crossings: list[Box], plan: OfficePlan, fitter: Fitter, rng: np.random.Generator
) -> None:
    """Fill what lies between two corridors: blocks of two rows back to back, or halls."""
    wall = CORRIDOR_WALL
    y0, y1 = lower.y1 + wall, upper.y0 - wall
    middle = 0.5 * (y0 + y1)
    ends = [lower.x0, *(end for crossing in crossings for end in (crossing.x0 - wall, crossing.x1 + wall)), lower.x1]
    blocks = [block for block in zip(ends[::2], ends[1::2], strict=True) if block[1] - block[0] > 1.5 * plan.door]
    certain = int(rng.integers(max(1, len(blocks))))
    for number, (x0, x1) in enumerate(blocks):
        south = Wall(x0, lower.y1, x1, y0, room_side=1)
        north = Wall(x0, y1, x1, upper.y0, room_side=-1)
        if number == certain or rng.random() < HALL_SHARE:
            cut = _hall_end(x0, x1, plan, rng)
            hall = fitter.draft.add_room(box_of(x0, y0, cut, y1))
            fitter.wide_door(hall, south)
            fitter.wide_door(hall, north)
            fitter.furnish_hall(hall)
            x0 = cut + wall
        if x1 - x0 > 1.5 * plan.door:
            _fill_row(Row(box_of(x0, y0, x1, middle - 0.5 * wall), south), plan, fitter, rng)
            _fill_row(Row(box_of(x0, middle + 0.5 * wall, x1, y1), north), plan, fitter, rng)


def _hall_end(x0: float, x1: float, plan: OfficePlan, rng: np.random.Generator) -> float:
    """Return where a hall that begins at `x0` ends: three rooms on, or with the block."""
    end = x0 + rng.uniform(2.5, 4.0) * plan.room
    return x1 if x1 - end < plan.room else end


def _fill_row(row: Row, plan: OfficePlan, fitter: Fitter, rng: np.random.Generator) -> None:
    """Divide a row into rooms, each with a door to the corridor."""
    place = row.place
    n = max(1, round(place.width / plan.room))
    weights = rng.uniform(0.7, 1.5, n)
    partitions = np.round(rng.uniform(*PARTITIONS, n - 1), 2)
    widths = (place.width - partitions.sum()) * weights / weights.sum()
    x, last = place.x0, None
    for number, width in enumerate(widths.tolist()):
        end = place.x1 if number == n - 1 else x + width
        room = fitter.draft.add_room(box_of(x, place.y0, end, place.y1))
        fitter.door(room, row.corridor_wall)
        if last is not None:
            fitter.connect(last, room)
        if number < n - 1:
            x = end + float(partitions[number])
        last = room
    for room in fitter.draft.rooms[-n:]:
        fitter.furnish(room)
