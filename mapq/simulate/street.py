"""One side of a street: buildings, what is in front of them, and people and cars that move meanwhile."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SimulateSettings
from mapq.simulate.buildings import (
    BALCONIES_CHANCE,
    HEDGE_CHANCE,
    SHORTEST_YARD,
    YARD_CHANCE,
    add_balconies,
    add_building,
    add_hedge,
    add_yard,
)
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import Kind, Line, SceneBuilder

Floats = NDArray[np.float64]

PAVEMENT = 2.2
"""Width of a pavement in metres."""

KERB = 0.12
"""Height of a kerb in metres."""

GAP_CHANCE = 0.5
"""Chance of a narrow gap between two neighbours, times `look_alikes`."""

PARKING_WIDTH = 10.5
"""Metres of a street's width below which no car parks: the robot must pass between two of them."""

RAILING_CHANCE = 0.6
"""Chance of a fence in front of a building, times `look_alikes`."""

METRES_PER_PERSON = 11.0
METRES_PER_CAR = 45.0
"""Of the robot's way, at clutter 1."""


class Row(NamedTuple):
    """One row of buildings of a depth in metres, on or behind a line.

    The first and the last side wall may face a street. In front is a street, with a pavement and room for cars, or a
    pathway.
    """

    line: Line
    depth: float
    open_ends: tuple[bool, bool]
    is_street: bool


def add_row(builder: SceneBuilder, row: Row, settings: SimulateSettings, rng: np.random.Generator) -> None:
    """Add a row of buildings with its pavement, fences, cars, trees and lamps."""
    if row.is_street:
        add_pavement(builder, row.line)
    lots = list(_lots(row.line.length, settings, rng))
    before = None
    for k, (first, last) in enumerate(lots):
        is_first, is_last = k == 0, k == len(lots) - 1
        open_sides = (is_first and row.open_ends[0], is_last and row.open_ends[1])
        front = _front(row.line.piece(first, last), rng)
        height = rng.uniform(*settings.height)
        if _has(YARD_CHANCE, settings, rng) and front.length > SHORTEST_YARD and row.is_street:
            add_yard(builder, front, row.depth, rng)
            before = None
            continue
        side, after = add_building(builder, front, row.depth * rng.uniform(0.85, 1.0), height, open_sides, rng)
        if before is not None and side is not None and first > lots[k - 1][1]:
            builder.look_alike(before, side)
        before = after
        if rng.random() < RAILING_CHANCE * settings.look_alikes:
            _add_fence(builder, front, rng)
        if _has(BALCONIES_CHANCE, settings, rng):
            add_balconies(builder, front, height, rng)
        if _has(HEDGE_CHANCE, settings, rng):
            add_hedge(builder, front, rng)
    _add_furniture(builder, row, settings, rng)


def _has(chance: float, settings: SimulateSettings, rng: np.random.Generator) -> bool:
    """Return whether a lot has something; a world without variety draws no numbers for it."""
    return settings.variety > 0.0 and bool(rng.random() < chance * settings.variety)


def _lots(length: float, settings: SimulateSettings, rng: np.random.Generator) -> Iterator[tuple[float, float]]:
    """Yield where each building begins and ends; the last one takes the rest."""
    shortest, longest = settings.frontage
    start = 0.0
    while length - start > 0.5:
        # Cubed: short facades are the more common ones.
        size = shortest + (longest - shortest) * rng.random() ** 3
        if start + size + 0.7 * shortest > length:
            size = length - start
        yield start, start + size
        start += size
        if rng.random() < GAP_CHANCE * settings.look_alikes:
            start += rng.uniform(0.2, 1.5)


def _front(lot: Line, rng: np.random.Generator) -> Line:
    """Return the facade's line on its lot: set back or not, and turned a little."""
    setback = rng.choice([0.0, 0.0, 0.3, 0.8, 1.4]) + rng.uniform(0.0, 0.15)
    tilt = np.clip(rng.normal(0.0, 0.012), -0.03, 0.03) * lot.length
    return Line.facing(
        lot.start + (setback + max(tilt, 0.0)) * lot.inward,
        lot.end + (setback + max(-tilt, 0.0)) * lot.inward,
        lot.inward,
    )


def _add_fence(builder: SceneBuilder, front: Line, rng: np.random.Generator) -> None:
    length = min(front.length - 0.4, rng.uniform(4.0, 12.0))
    first = rng.uniform(0.2, front.length - length)
    add_railing(builder, front.piece(first, first + length).shifted(-rng.uniform(0.4, 1.3)), rng)


def _add_furniture(builder: SceneBuilder, row: Row, settings: SimulateSettings, rng: np.random.Generator) -> None:
    """Add parked cars beside the kerb, trees and lamps on the pavement, bushes before the facades."""
    if not row.is_street:
        return
    lane, kerb = row.line.shifted(-PAVEMENT - 0.95), row.line.shifted(0.3 - PAVEMENT)
    beds = row.line.shifted(-0.4)
    along = row.line.along
    for u in np.arange(3.5, row.line.length - 3.5, 5.6):
        if settings.street_width >= PARKING_WIDTH and rng.random() < 0.4 * settings.clutter:
            heading = along if rng.random() < 0.5 else -along
            add_parked_car(builder, lane.start + (u + rng.uniform(-0.4, 0.4)) * along, heading, rng)
    for u in np.arange(5.0, row.line.length - 2.0, 11.0):
        place = kerb.start + (u + rng.uniform(-2.0, 2.0)) * along
        if rng.random() < 0.45 * settings.clutter:
            add_tree(builder, place, rng)
        elif rng.random() < 0.45 * settings.clutter:
            add_lamp(builder, place, rng)
        if rng.random() < 0.35 * settings.clutter:
            add_bush(builder, beds.start + (u + rng.uniform(-4.0, 4.0)) * along, rng)


def add_pavement(builder: SceneBuilder, line: Line) -> None:
    """Add a pavement in front of a row of facades, with its kerb; it continues behind their setbacks."""
    edge = line.shifted(-PAVEMENT)
    builder.wall(edge.start, edge.end, (0.0, KERB), Kind.KERB)
    along, across = np.array([*(edge.end - edge.start), 0.0]), np.array([*((PAVEMENT + 3.0) * line.inward), 0.0])
    builder.sheet(np.array([*edge.start, KERB]), along, across, Kind.GROUND)


def add_railing(builder: SceneBuilder, line: Line, rng: np.random.Generator) -> None:
    """Add a fence of thin bars, or of boards, along a facade: parallel to it, close, and true."""
    height = rng.uniform(0.9, 1.4)
    pitch, bar = rng.uniform(0.11, 0.16), rng.uniform(0.025, 0.05)
    if rng.random() < 0.3:
        pitch, bar = 0.2, 0.17
    across = (0.0, pitch, pitch - bar, line.length)
    upward = (0.12, height, height - 0.2, height - 0.08)
    fence = builder.wall(line.start, line.end, (0.0, height), Kind.RAILING, holes=(across, upward))
    builder.look_alike(fence, fence)


def add_garden_wall(builder: SceneBuilder, line: Line, height: float, thickness: float) -> None:
    """Add a free-standing wall that a robot sees from both sides: two faces, two ends and a top."""
    other = line.shifted(thickness)
    faces = [builder.wall(face.start, face.end, (0.0, height), Kind.GARDEN_WALL) for face in (line, other)]
    builder.look_alike(faces[0], faces[1])
    for a, b in ((line.start, other.start), (line.end, other.end)):
        builder.wall(a, b, (0.0, height), Kind.GARDEN_WALL)
    across = np.array([*(thickness * line.inward), 0.0])
    builder.sheet(np.array([*line.start, height]), np.array([*(line.end - line.start), 0.0]), across, Kind.GARDEN_WALL)


def add_parked_car(builder: SceneBuilder, centre: Floats, along: Floats, rng: np.random.Generator) -> None:
    """Add a car: a body with upright sides, and a cabin with a sloped front and rear."""
    length, width = rng.uniform(3.7, 4.7), rng.uniform(1.6, 1.8)
    waist, top = rng.uniform(0.78, 0.95), rng.uniform(1.38, 1.6)
    across = np.array([-along[1], along[0]])
    marks = length * np.array([0.0, 0.24, 0.38, 0.82, 0.95, 1.0])

    def corner(u: float, side: float) -> Floats:
        return np.asarray(centre + (u - 0.5 * length) * along + side * 0.5 * width * across)

    for side in (-1.0, 1.0):
        body = builder.wall(corner(0.0, side), corner(length, side), (0.22, waist), Kind.PARKED_CAR)
        builder.wall(corner(marks[2], side), corner(marks[3], side), (waist, top), Kind.PARKED_CAR, body)
    for u in (0.0, length):
        builder.wall(corner(u, -1.0), corner(u, 1.0), (0.22, waist), Kind.PARKED_CAR)
    heights = (waist, waist, top, top, waist, waist)
    over = np.array([*(width * across), 0.0])
    for first in range(5):
        low, high = heights[first], heights[first + 1]
        rise = np.array([*((marks[first + 1] - marks[first]) * along), high - low])
        builder.sheet(np.array([*corner(marks[first], -1.0), low]), rise, over, Kind.PARKED_CAR)


def add_tree(builder: SceneBuilder, xy: Floats, rng: np.random.Generator) -> None:
    """Add a trunk and a crown of two or three overlapping volumes of leaves."""
    height = rng.uniform(2.2, 3.2)
    builder.post(xy, rng.uniform(0.1, 0.2), (0.0, height + 0.8))
    for _ in range(int(rng.integers(2, 4))):
        offset = rng.normal(0.0, 0.45, 2)
        radii = (rng.uniform(0.9, 1.7), rng.uniform(0.8, 1.5))
        centre = np.array([*(xy + offset), height + radii[1] + rng.uniform(-0.3, 0.8)])
        builder.blob(centre, radii, rng.uniform(0.5, 1.6))


def add_bush(builder: SceneBuilder, xy: Floats, rng: np.random.Generator) -> None:
    """Add a volume of leaves on the ground."""
    radii = (rng.uniform(0.4, 0.9), rng.uniform(0.4, 0.8))
    builder.blob(np.array([*xy, 0.8 * radii[1]]), radii, rng.uniform(2.0, 6.0))


def add_lamp(builder: SceneBuilder, xy: Floats, rng: np.random.Generator) -> None:
    """Add a lamp post."""
    builder.post(xy, rng.uniform(0.06, 0.1), (0.0, rng.uniform(5.0, 8.0)))


def add_archway(
    builder: SceneBuilder, line: Line, depth: float, height: float, opening: tuple[float, float, float]
) -> None:
    """Add a building across a pathway, with an archway: where it begins and ends along the front, its clear height."""
    first, last, clear = opening
    splay = 0.5
    across = (first, last - first + 1.0, last - first, last)
    upward = (0.0, clear + 1.0, clear, clear)
    for face in (line, line.shifted(depth)):
        builder.wall(face.start, face.end, (0.0, height), Kind.ARCH, holes=(across, upward))
    for end in (line.start, line.end):
        builder.wall(end, end + depth * line.inward, (0.0, height), Kind.SIDE_WALL)
    through = np.array([*(depth * line.inward), 0.0])
    a, b = line.start + first * line.along, line.start + last * line.along
    step = splay * line.along
    for foot, turn in ((a, 1.0), (b, -1.0)):
        # The inner side wall, and above it a slope that rounds the arch.
        builder.wall(foot, foot + depth * line.inward, (0.0, clear - splay), Kind.ARCH)
        builder.sheet(np.array([*foot, clear - splay]), np.array([*(turn * step), splay]), through, Kind.ARCH)
        _add_pier(builder, foot, line, -turn)
    soffit = np.array([*((last - first - 2.0 * splay) * line.along), 0.0])
    builder.sheet(np.array([*(a + step), clear]), soffit, through, Kind.ARCH)


def _add_pier(builder: SceneBuilder, foot: Floats, line: Line, side: float) -> None:
    """Add a pier that projects from the front beside the opening."""
    reach = -0.45 * line.inward
    outer = foot + side * 0.7 * line.along
    for a, b in ((foot, foot + reach), (outer, outer + reach), (foot + reach, outer + reach)):
        builder.wall(a, b, (0.0, 2.6), Kind.ARCH)


def add_traffic(builder: SceneBuilder, way: Trajectory, settings: SimulateSettings, rng: np.random.Generator) -> None:
    """Add people on the pavements and, where the street is wide enough, cars in the other lane."""
    for _ in range(rng.poisson(settings.clutter * way.length / METRES_PER_PERSON)):
        _add_person(builder, way, settings, rng)
    if settings.street_width < 12.0:
        return
    for _ in range(rng.poisson(settings.clutter * way.length / METRES_PER_CAR)):
        _add_car(builder, way, settings, rng)


def _add_person(builder: SceneBuilder, way: Trajectory, settings: SimulateSettings, rng: np.random.Generator) -> None:
    """Add somebody who walks along the street for up to sixteen seconds, some metres before the robot."""
    distance = rng.uniform(0.0, way.length)
    side = rng.choice([-1.0, 1.0])
    lateral = side * (0.5 * settings.street_width - rng.uniform(0.8, 2.0))
    pace = rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.6)
    start, velocity = _beside(way, distance, rng.uniform(2.0, 14.0), lateral, pace)
    time, span = distance / settings.speed, rng.uniform(4.0, 8.0)
    height = rng.uniform(1.5, 1.9)
    times = (time - span, time + span)
    builder.mover(start - span * velocity, velocity, times, rng.uniform(0.18, 0.28), (0.05, height), Kind.PERSON)


def _add_car(builder: SceneBuilder, way: Trajectory, settings: SimulateSettings, rng: np.random.Generator) -> None:
    """Add an oncoming car: a body and a cabin, both boxes; not where the robot turns."""
    distance = rng.uniform(0.0, way.length)
    _, headings = way.at(np.clip(distance + np.array([-6.0, 14.0]), 0.0, way.length))
    pace = -rng.uniform(4.0, 9.0)
    start, velocity = _beside(way, distance, rng.uniform(6.0, 16.0), rng.uniform(2.6, 3.2), pace)
    half, waist, top = rng.uniform(1.9, 2.3), rng.uniform(0.8, 0.95), rng.uniform(1.4, 1.6)
    if abs(headings[1] - headings[0]) > 0.1:
        return
    time, span = distance / settings.speed, 3.0
    times = (time - span, time + span)
    begin = start - span * velocity
    builder.mover(begin, velocity, times, (half, 0.85), (0.2, waist), Kind.MOVING_CAR)
    builder.mover(begin, velocity, times, (0.55 * half, 0.8), (waist, top), Kind.MOVING_CAR)


def _beside(way: Trajectory, distance: float, ahead: float, left: float, pace: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a place (2,) seen from the robot, and a velocity (2,) along its heading."""
    xy, heading = way.at(np.array([distance]))
    c, s = np.cos(heading[0]), np.sin(heading[0])
    return xy[0] + ahead * np.array([c, s]) + left * np.array([-s, c]), pace * np.array([c, s])
