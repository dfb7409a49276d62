"""Buildings: facades with recessed windows one by one, in ribbons or in bays, setbacks of upper storeys; and yards.

Yards, sheds, balconies and hedges are true surfaces that lie near and parallel to one another at half a metre to three,
which streets of offices lack, and rough and curved ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from mapq.simulate.scene import Kind, Line, SceneBuilder

YARD_CHANCE = 0.12
"""Chance that a lot has a yard in place of a building, times `variety`."""

BALCONIES_CHANCE, HEDGE_CHANCE = 0.15, 0.12
"""Chances that a building has balconies, and a hedge in front of it, times `variety`."""

SHED_CHANCE = 0.4
"""Chance of a shed or a lorry in a garden, times `variety`."""

SHORTEST_YARD = 7.0
"""Metres of frontage."""


class Style(Enum):
    """How the windows of a facade are arranged."""

    GRID = 0
    RIBBONS = 1
    BAYS = 2


@dataclass(frozen=True)
class Windows:
    """The grid of windows of one building; lengths in metres.

    From window to window along the facade, and of one window; heights of a storey, of the parapet below the window and
    of the window; how far the pane lies behind the facade; and the style of the storeys above the ground.
    """

    pitch: float
    width: float
    storey: float
    sill: float
    height: float
    recess: float
    style: Style


def draw_windows(rng: np.random.Generator) -> Windows:
    """Return the windows of one building."""
    pitch = rng.uniform(2.6, 4.4)
    storey = rng.uniform(3.0, 3.8)
    return Windows(
        pitch,
        pitch * rng.uniform(0.52, 0.78),
        storey,
        rng.uniform(0.6, 0.95),
        storey * rng.uniform(0.48, 0.62),
        rng.uniform(0.15, 0.4),
        Style(int(rng.integers(len(Style)))),
    )


def add_facade(
    builder: SceneBuilder, line: Line, z: tuple[float, float], windows: Windows, rng: np.random.Generator
) -> None:
    """Add a facade with as many windows as fit, and a door if it begins on the ground."""
    columns = int((line.length - 0.8) / windows.pitch)
    storeys = int((z[1] - z[0]) / windows.storey)
    if columns < 1 or storeys < 1:
        builder.wall(line.start, line.end, z, Kind.FACADE)
        return
    upper, plane = z[0], None
    if z[0] == 0.0:
        upper, plane = windows.storey, builder.surface(line.inward)
        _add_ground_floor(builder, line, windows, plane, columns, rng)
    if upper > z[1] - 1e-9:
        return
    if windows.style is Style.RIBBONS:
        _add_ribbons(builder, line, (upper, z[1]), windows, plane)
    elif windows.style is Style.BAYS:
        _add_bays(builder, line, (upper, z[1]), windows, plane, columns)
    else:
        margin = 0.5 * (line.length - columns * windows.pitch)
        _add_windows(builder, line, (upper, z[1]), windows, plane, (margin, columns))


def _add_ground_floor(
    builder: SceneBuilder, line: Line, windows: Windows, surface: int, columns: int, rng: np.random.Generator
) -> None:
    """Add the storey on the ground, with a door in place of one window."""
    margin = 0.5 * (line.length - columns * windows.pitch)
    door = int(rng.integers(columns))
    first, last = margin + door * windows.pitch, margin + (door + 1) * windows.pitch
    top = windows.storey
    _add_door(builder, line.piece(first, last), windows, surface)
    _add_windows(builder, line.piece(0.0, first), (0.0, top), windows, surface, (margin, door))
    _add_windows(builder, line.piece(last, line.length), (0.0, top), windows, surface, (0.0, columns - door - 1))


def _add_ribbons(
    builder: SceneBuilder, line: Line, z: tuple[float, float], windows: Windows, plane: int | None
) -> None:
    """Add storeys of which each has one window from end to end; the walls between them do not touch each other.

    `plane` is the surface of the storey below, if there is one: what touches it belongs to it.
    """
    behind = line.shifted(windows.recess)
    low = z[0]
    for storey in range(int((z[1] - z[0]) / windows.storey + 1e-9)):
        sill = z[0] + storey * windows.storey + windows.sill
        lintel = sill + windows.height
        builder.wall(line.start, line.end, (low, sill), Kind.FACADE, plane if storey == 0 else None)
        builder.wall(behind.start, behind.end, (sill, lintel), Kind.RECESS)
        for edge in (sill, lintel):
            _add_ledge(builder, line, edge, windows.recess)
        low = lintel
    builder.wall(line.start, line.end, (low, z[1]), Kind.FACADE)


def _add_bays(
    builder: SceneBuilder, line: Line, z: tuple[float, float], windows: Windows, plane: int | None, columns: int
) -> None:
    """Add storeys with projecting pilasters, with bays of wall and glass between them."""
    margin = 0.5 * (line.length - columns * windows.pitch)
    last = 0.0
    for column in range(columns):
        first = margin + column * windows.pitch + 0.5 * (windows.pitch - windows.width)
        bay = line.piece(first, first + windows.width)
        pilaster = line.piece(last, first)
        builder.wall(pilaster.start, pilaster.end, z, Kind.FACADE, plane)
        _add_pane(builder, bay, z, windows.recess)
        _add_jambs(builder, bay, z, windows.recess)
        last = first + windows.width
    rest = line.piece(last, line.length)
    builder.wall(rest.start, rest.end, z, Kind.FACADE, plane)
    _add_ledge(builder, line, z[0], windows.recess)


def _add_door(builder: SceneBuilder, line: Line, windows: Windows, surface: int) -> None:
    """Add one column of the ground floor with a door instead of a window."""
    first = 0.5 * (line.length - windows.width)
    height = min(2.3, windows.storey - 0.2)
    holes = ((first, line.length, windows.width, first + windows.width), (0.0, height + 1.0, height, height))
    builder.wall(line.start, line.end, (0.0, windows.storey), Kind.FACADE, surface, holes)
    _add_recess(builder, line.piece(first, first + windows.width), (0.0, height), windows.recess)


def _add_windows(
    builder: SceneBuilder,
    line: Line,
    z: tuple[float, float],
    windows: Windows,
    surface: int | None,
    columns: tuple[float, int],
) -> None:
    """Add a part of a facade with storeys of windows; `columns`: where the first one begins, and how many."""
    margin, n_columns = columns
    n_storeys = int((z[1] - z[0]) / windows.storey + 1e-9)
    if n_columns < 1 or n_storeys < 1:
        builder.wall(line.start, line.end, z, Kind.FACADE, surface)
        return
    first = margin + 0.5 * (windows.pitch - windows.width)
    low = z[0] + windows.sill
    across = (first, windows.pitch, windows.width, first + n_columns * windows.pitch - 1e-6)
    upward = (low, windows.storey, windows.height, low + n_storeys * windows.storey - 1e-6)
    builder.wall(line.start, line.end, z, Kind.FACADE, surface, (across, upward))
    for column in range(n_columns):
        u = first + column * windows.pitch
        opening = line.piece(u, u + windows.width)
        bottoms = [low + storey * windows.storey for storey in range(n_storeys)]
        for bottom in bottoms:
            _add_pane(builder, opening, (bottom, bottom + windows.height), windows.recess)
        _add_jambs(builder, opening, (bottoms[0], bottoms[-1] + windows.height), windows.recess)
    for storey in range(n_storeys):
        bottom = low + storey * windows.storey
        for edge in (bottom, bottom + windows.height):
            _add_ledge(builder, line, edge, windows.recess)


def _add_recess(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    """Add what is behind one hole: a pane or a door, its two sides, and its lintel."""
    _add_pane(builder, opening, z, recess)
    _add_jambs(builder, opening, z, recess)
    _add_ledge(builder, opening, z[1], recess)


def _add_pane(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    pane = opening.shifted(recess)
    builder.wall(pane.start, pane.end, z, Kind.RECESS)


def _add_jambs(builder: SceneBuilder, opening: Line, z: tuple[float, float], recess: float) -> None:
    """Add the two sides of the openings of one column, in one piece: behind the facade it is not seen."""
    for corner in (opening.start, opening.end):
        builder.wall(corner, corner + recess * opening.inward, z, Kind.REVEAL)


def _add_ledge(builder: SceneBuilder, line: Line, z: float, recess: float) -> None:
    """Add the sills or the lintels of a storey."""
    along, inward = np.array([*(line.end - line.start), 0.0]), np.array([*(recess * line.inward), 0.0])
    builder.sheet(np.array([*line.start, z]), along, inward, Kind.REVEAL)


def add_building(
    builder: SceneBuilder,
    front: Line,
    depth: float,
    height: float,
    open_sides: tuple[bool, bool],
    rng: np.random.Generator,
) -> tuple[int | None, int | None]:
    """Add a building behind its front line, and return the surfaces of its two blank side walls, None for an open one.

    The sides at the line's start and at its end are open if they face a street: these have windows.
    """
    windows = draw_windows(rng)
    back = front.shifted(depth)
    builder.wall(back.start, back.end, (0.0, height), Kind.SIDE_WALL)
    setback = height > 2.4 * windows.storey and rng.random() < 0.2
    lower = windows.storey * np.floor(height / windows.storey - 1.0) if setback else height
    add_facade(builder, front, (0.0, lower), windows, rng)
    if setback:
        inset = rng.uniform(1.0, 2.5)
        add_facade(builder, front.shifted(inset), (lower, height), windows, rng)
        flat = np.array([*(front.inward * inset), 0.0])
        builder.sheet(np.array([*front.start, lower]), np.array([*(front.end - front.start), 0.0]), flat, Kind.ROOF)
    sides: list[int | None] = [None, None]
    for end, is_open in enumerate(open_sides):
        corners = (front.start, back.start) if end == 0 else (front.end, back.end)
        if is_open:
            inward = front.along if end == 0 else -front.along
            add_facade(builder, Line(*corners, inward), (0.0, height), windows, rng)
        else:
            sides[end] = builder.wall(*corners, (0.0, height), Kind.SIDE_WALL)
    return sides[0], sides[1]


def add_yard(builder: SceneBuilder, front: Line, depth: float, rng: np.random.Generator) -> None:
    """Add a yard with lorries or containers side by side, their ends to the street, before a wall; tanks between."""
    back = front.shifted(depth)
    builder.wall(back.start, back.end, (0.0, rng.uniform(3.0, 6.0)), Kind.SIDE_WALL)
    length = min(rng.uniform(5.0, 9.0), depth - 1.5)
    width, height, gap = rng.uniform(2.2, 2.6), rng.uniform(2.2, 3.8), rng.uniform(0.4, 1.4)
    place, before = rng.uniform(0.3, 1.5), None
    while place + width < front.length - 0.3:
        bay = front.piece(place, place + width).shifted(rng.uniform(0.2, 1.2))
        if rng.random() < 0.1:
            middle = bay.start + 0.5 * width * (bay.along + bay.inward)
            builder.post(middle, 0.5 * width, (0.0, height))
            before = None
        elif rng.random() < 0.85:
            sides = add_box(builder, _askew(bay, rng), length, (0.0, height), Kind.LORRY)
            if before is not None:
                builder.look_alike(before, sides[0])
            before = sides[1]
        else:
            before = None
        place += width + gap * rng.uniform(0.7, 1.3)


def _askew(line: Line, rng: np.random.Generator) -> Line:
    """Return the line turned by up to some degrees, as cars are parked."""
    end = line.end + np.clip(rng.normal(0.0, 0.03), -0.08, 0.08) * line.length * line.inward
    return Line.facing(line.start, end, line.inward)


def add_box(builder: SceneBuilder, front: Line, depth: float, z: tuple[float, float], kind: Kind) -> tuple[int, int]:
    """Add four upright faces and a top behind a front line; return the surfaces of the sides at its start and end."""
    back = front.shifted(depth)
    for line in (front, back):
        builder.wall(line.start, line.end, z, kind)
    sides = [builder.wall(a, b, z, kind) for a, b in ((front.start, back.start), (front.end, back.end))]
    over = np.array([*(depth * front.inward), 0.0])
    builder.sheet(np.array([*front.start, z[1]]), np.array([*(front.end - front.start), 0.0]), over, kind)
    return sides[0], sides[1]


def add_shed(builder: SceneBuilder, line: Line, rng: np.random.Generator) -> None:
    """Add a shed, a kiosk or a lorry that is seen from more than one side."""
    first = rng.uniform(0.0, 0.3 * line.length)
    length = min(rng.uniform(2.0, 6.0), line.length - first)
    front = line.piece(first, first + length)
    add_box(builder, _askew(front, rng), rng.uniform(0.6, 2.5), (0.0, rng.uniform(1.8, 3.2)), Kind.SHED)


def add_balconies(builder: SceneBuilder, front: Line, height: float, rng: np.random.Generator) -> None:
    """Add rows of balconies: parapets parallel to the facade, a metre before it."""
    depth, width, storey = rng.uniform(0.7, 1.6), rng.uniform(2.0, 4.5), rng.uniform(2.8, 3.6)
    pitch = width + rng.uniform(0.5, 3.0)
    parapet = rng.uniform(0.9, 1.3)
    for low in np.arange(storey, height - storey, storey):
        for first in np.arange(0.5, front.length - width, pitch):
            edge = front.piece(first, first + width).shifted(-depth)
            add_box(builder, edge, depth, (float(low), float(low + parapet)), Kind.BALCONY)


def add_hedge(builder: SceneBuilder, front: Line, rng: np.random.Generator) -> None:
    """Add a clipped hedge along the facade: a row of dense leaves, upright and rough."""
    inset, radius, height = rng.uniform(0.6, 1.2), rng.uniform(0.3, 0.5), rng.uniform(0.6, 1.2)
    line = front.shifted(-inset)
    for along in np.arange(radius, line.length - radius, 0.7 * radius):
        centre = line.start + along * line.along
        builder.blob(np.array([*centre, 0.8 * height]), (radius, height), rng.uniform(8.0, 14.0))
