"""Generated floor plans: corridors with rooms on both sides, doors in varied states, halls with pillars."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from prf.model.window import Window
from prf.shell.errors import ConfigError
from prf.simulate.fittings import Box, Draft, Wall, box_of
from prf.simulate.world import World

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


class Row(NamedTuple):
    """A row of rooms: where, and the wall towards its corridor."""

    place: Box
    corridor_wall: Wall


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
        _fill_row(row, draft, rng)
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
            _fill_row(Row(box_of(x0, y0, x1, middle - 0.5 * wall), south), draft, rng)
            _fill_row(Row(box_of(x0, middle + 0.5 * wall, x1, y1), north), draft, rng)


def _hall_end(x0: float, x1: float, rng: np.random.Generator) -> float:
    """Return where a hall that begins at `x0` ends: three rooms on, or with the block."""
    end = x0 + rng.uniform(2.5, 4.0) * ROOM
    return x1 if x1 - end < ROOM else end


def _fill_row(row: Row, draft: Draft, rng: np.random.Generator) -> None:
    """Divide a row into rooms, each with a door to the corridor."""
    place = row.place
    n = max(1, round(place.width / ROOM))
    weights = rng.uniform(0.7, 1.5, n)
    partitions = np.round(rng.uniform(*PARTITIONS, n - 1), 2)
    widths = (place.width - partitions.sum()) * weights / weights.sum()
    x, last = place.x0, None
    for number, width in enumerate(widths.tolist()):
        end = place.x1 if number == n - 1 else x + width
        room = draft.add_room(box_of(x, place.y0, end, place.y1))
        draft.door(room, row.corridor_wall)
        if last is not None:
            draft.connect(last, room)
        if number < n - 1:
            x = end + float(partitions[number])
        last = room
    for room in draft.rooms[-n:]:
        draft.furnish(room)
