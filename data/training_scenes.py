"""What stands in the simulated worlds on which the shipped model is trained: halls, offices, corridors, streets, quads.

Every wall is made of its faces, each a surface of its own, and of what is left of them round openings. Everything is
drawn from one generator. `make_site` draws the kind of the world as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.simulate.buildings import add_balconies, add_building, add_facade, add_hedge, add_shed, add_yard, draw_windows
from mapq.simulate.scene import Frame, Kind, Line, SceneBuilder, World

Floats = NDArray[np.float64]
Rng = np.random.Generator
Rect = tuple[float, float, float, float]
"""x0, y0, x1, y1 in metres, in the frame of the world's block."""
Opening = tuple[float, float, float, float]
"""Begin and end along a wall, bottom and top, in metres."""

BEYOND = 8.0
"""Metres that the grid of the scene goes beyond everything: no sensor stands farther out."""
LONGEST_SLOPE = 0.06
PERIODS = 400
"""Seconds that people stay within: each goes its own way at its own time."""


class Site(NamedTuple):
    """A world and where a sensor may be in it.

    Attributes
    ----------
    kind : str
        Name of the kind of the world, one of `SITES`.
    world : World
    corners : (2, 2) float64
        Lowest and highest x and y of where a sensor may be.
    frame : Frame
    area : (4,) tuple of float
        Where a sensor may be, in that frame: x0, y0, x1, y1.
    start : (2,) float64
        A place from which everything that is open can be reached.
    slope : (3,) float64
        Height of the ground in metres: at the origin, and per metre of x and of y.
    height : float
        Metres: of rooms, above which no sensor stands; inf outdoors.
    """

    kind: str
    world: World
    corners: Floats
    frame: Frame
    area: Rect
    start: Floats
    slope: Floats
    height: float

    def ground(self, xy: Floats) -> Floats:
        """Return the height (n,) of the ground at places (n, 2)."""
        return np.asarray(np.maximum(self.slope[0] + xy @ self.slope[1:], 0.0))

    def may_stand(self, xy: Floats) -> NDArray[np.bool_]:
        """Return whether a sensor may be at places (n, 2), walls left aside."""
        c, s = np.cos(self.frame.heading), np.sin(self.frame.heading)
        x, y = (xy - self.frame.origin).T
        ahead, left = c * x + s * y, self.frame.side * (c * y - s * x)
        x0, y0, x1, y1 = self.area
        return np.asarray((ahead >= x0) & (ahead <= x1) & (left >= y0) & (left <= y1))


def make_site(rng: Rng, kind: str | None = None) -> Site:
    """Return a world of a drawn or given kind."""
    name = kind or str(rng.choice(list(SITES)))
    builder = SceneBuilder()
    builder.frame = Frame(rng.uniform(-50.0, 50.0, 2), rng.uniform(-np.pi, np.pi), float(rng.choice([-1.0, 1.0])))
    area, start, slope, height = SITES[name](builder, rng)
    if slope == 0.0:
        # Through gates some go out, and see outer walls from both sides.
        out = float(rng.choice([0.0, 0.0, 6.0]))
        area = (area[0] - out, area[1] - out, area[2] + out, area[3] + out)
    corners = builder.frame.place(np.array([(x, y) for x in area[::2] for y in area[1::2]]))
    turned = builder.frame.turn(np.array([slope, 0.0]))
    origin = -float(turned @ builder.frame.origin)
    return Site(
        name,
        builder.finish(BEYOND),
        np.array([corners.min(axis=0), corners.max(axis=0)]),
        builder.frame,
        area,
        builder.frame.place(np.asarray(start, np.float64)),
        np.array([origin, *turned]),
        height,
    )


# Parts of which all worlds are made.


def add_wall(
    builder: SceneBuilder, a: Floats, b: Floats, z: tuple[float, float], thickness: float, openings: Sequence[Opening]
) -> None:
    """Add a wall with two faces, its ends, and the sides of its openings, which may not overlap."""
    along = (b - a) / np.hypot(*(b - a))
    across = 0.5 * thickness * np.array([-along[1], along[0]])
    length, sides = float(np.hypot(*(b - a))), ((1.0, builder.surface(across)), (-1.0, builder.surface(across)))
    holes = sorted(hole for hole in openings if hole[0] >= 0.0 and hole[1] <= length and hole[1] > hole[0])
    pieces, last = [], 0.0
    for begin, end, low, high in holes:
        if begin < last:
            continue
        pieces += [(last, begin, *z), (begin, end, z[0], low), (begin, end, high, z[1])]
        _line_opening(builder, (a + begin * along, a + end * along), across, (low, high))
        last = end
    pieces.append((last, length, *z))
    for begin, end, low, high in pieces:
        if end - begin > 0.01 and high - low > 0.01:
            for side, surface in sides:
                place = a + side * across
                builder.wall(place + begin * along, place + end * along, (low, high), Kind.SIDE_WALL, surface)
    for corner in (a, b):
        builder.wall(corner - across, corner + across, z, Kind.REVEAL)


def _line_opening(builder: SceneBuilder, ends: tuple[Floats, Floats], across: Floats, z: tuple[float, float]) -> None:
    """Add the jambs, the lintel and the sill of an opening."""
    for place in ends:
        builder.wall(place - across, place + across, z, Kind.REVEAL)
    along, over = np.array([*(ends[1] - ends[0]), 0.0]), np.array([*(2.0 * across), 0.0])
    for height in z:
        if height > 0.05:
            builder.sheet(np.array([*(ends[0] - across), height]), along, over, Kind.REVEAL)


def add_box(
    builder: SceneBuilder,
    centre: Floats,
    half: tuple[float, float],
    z: tuple[float, float],
    heading: float = 0.0,
    kind: Kind = Kind.SHED,
) -> None:
    """Add an upright box with a lid."""
    c, s = np.cos(heading), np.sin(heading)
    one, other = half[0] * np.array([c, s]), half[1] * np.array([-s, c])
    corners = [centre - one - other, centre + one - other, centre + one + other, centre - one + other]
    for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
        builder.wall(corner, following, z, kind)
    sides = np.array([*(2.0 * one), 0.0]), np.array([*(2.0 * other), 0.0])
    for height in {z[1], z[0]} if z[0] > 0.05 else {z[1]}:
        builder.sheet(np.array([*corners[0], height]), *sides, kind)


def add_glass(builder: SceneBuilder, a: Floats, b: Floats, z: tuple[float, float]) -> None:
    """Add a pane, through which most beams go."""
    builder.wall(a, b, z, Kind.RECESS)


def drawn_openings(rng: Rng, length: float, height: float, share: float, floor: bool = True) -> list[Opening]:
    """Return doors, gates and windows of a wall, spaced at random, about `share` of what there is place for."""
    openings, place = [], rng.uniform(0.4, 2.0)
    while place < length - 1.2:
        kind = rng.choice(3, p=[0.5, 0.15, 0.35] if floor else [0.0, 0.0, 1.0])
        width = (rng.uniform(0.8, 1.3), rng.uniform(1.8, 4.5), rng.uniform(0.8, 2.2))[kind]
        bottom = (0.0, 0.0, rng.uniform(0.6, 1.1))[kind]
        tall = (rng.uniform(2.0, 2.3), rng.uniform(2.2, 4.0), bottom + rng.uniform(0.8, 1.6))[kind]
        if place + width < length - 0.3 and rng.random() < share:
            openings.append((place, place + width, bottom, min(tall, height - 0.2)))
        place += width + rng.uniform(0.5, 3.0)
    return openings


def add_wings(builder: SceneBuilder, a: Floats, b: Floats, holes: Sequence[Opening], rng: Rng) -> None:
    """Add walls beside gates that go through them: they reach to both sides of the wall."""
    along = (b - a) / np.hypot(*(b - a))
    across = np.array([-along[1], along[0]])
    for begin, end, low, high in holes:
        if low > 0.0 or end - begin < 1.8:
            continue
        reach, tall, thick = rng.uniform(0.8, 5.0, 2), rng.uniform(0.6, 1.0) * high, rng.uniform(0.08, 0.3)
        for place in (begin + 0.51 * thick, end - 0.51 * thick):
            middle = a + place * along
            add_wall(builder, middle - reach[0] * across, middle + reach[1] * across, (0.0, tall), thick, ())


def add_table(builder: SceneBuilder, centre: Floats, heading: float, rng: Rng) -> None:
    """Add a table: a slab on four legs, and perhaps a chair of boxes."""
    half = np.array([rng.uniform(0.4, 1.0), rng.uniform(0.3, 0.5)])
    height = rng.uniform(0.7, 0.8)
    add_box(builder, centre, (half[0], half[1]), (height - 0.03, height), heading)
    for corner in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        builder.post(centre + 0.85 * half * corner, 0.03, (0.0, height - 0.03))
    if rng.random() < 0.7:
        seat = centre + (half[1] + 0.4) * np.array([-np.sin(heading), np.cos(heading)])
        add_box(builder, seat, (0.22, 0.22), (0.4, 0.46), heading + rng.normal(0.0, 0.3))
        builder.post(seat, 0.04, (0.0, 0.4))


def add_person(builder: SceneBuilder, area: Rect, rng: Rng) -> None:
    """Add somebody who walks through the world."""
    start, goal = (builder.frame.place(_place(area, rng)) for _ in range(2))
    begin = rng.uniform(-60.0, PERIODS)
    speed = (goal - start) / max(float(np.hypot(*(goal - start))), 0.1) * rng.uniform(0.4, 1.5)
    times = (float(begin), float(begin + np.hypot(*(goal - start)) / np.hypot(*speed)))
    builder.mover(start, speed, times, rng.uniform(0.2, 0.3), (0.0, rng.uniform(1.55, 1.9)), Kind.PERSON)


def add_plant(builder: SceneBuilder, place: Floats, rng: Rng) -> None:
    """Add a bush or a plant in a pot."""
    height = rng.uniform(0.3, 0.8)
    builder.blob(np.array([*place, height]), (rng.uniform(0.2, 0.6), height), rng.uniform(2.0, 8.0))


def add_grass(builder: SceneBuilder, place: Floats, base: float, rng: Rng) -> None:
    """Add a patch of grass or low plants on the ground."""
    tall = rng.uniform(0.05, 0.4)
    builder.blob(np.array([*place, base]), (rng.uniform(0.8, 3.5), tall), rng.uniform(1.0, 12.0))


def add_tree(builder: SceneBuilder, place: Floats, base: float, rng: Rng) -> None:
    """Add a trunk with a crown of one to three clouds of leaves."""
    height = rng.uniform(2.5, 6.0)
    builder.post(place, rng.uniform(0.08, 0.25), (0.0, base + height))
    for _ in range(int(rng.integers(1, 4))):
        centre = np.array([*(place + rng.normal(0.0, 0.6, 2)), base + height + rng.uniform(0.0, 1.0)])
        builder.blob(centre, (rng.uniform(1.0, 2.2), rng.uniform(1.0, 2.0)), rng.uniform(0.8, 3.0))


def add_vehicle(builder: SceneBuilder, place: Floats, heading: float, base: float, rng: Rng) -> None:
    """Add a parked car of two boxes, or a lorry."""
    if rng.random() < 0.15:
        half = (rng.uniform(2.5, 5.0), rng.uniform(1.0, 1.3))
        add_box(builder, place, half, (base + 0.9, base + rng.uniform(2.6, 3.8)), heading, Kind.LORRY)
        add_box(builder, place, (half[0] - 0.3, 0.5), (base, base + 0.9), heading, Kind.LORRY)
        return
    half, roof = (rng.uniform(1.8, 2.4), rng.uniform(0.75, 0.95)), rng.uniform(0.8, 1.0)
    add_box(builder, place, half, (base + 0.2, base + roof), heading, Kind.PARKED_CAR)
    cabin = (half[0] * rng.uniform(0.45, 0.75), half[1] * 0.88)
    add_box(builder, place, cabin, (base + roof, base + roof + rng.uniform(0.45, 0.9)), heading, Kind.PARKED_CAR)


def add_steps(builder: SceneBuilder, start: Floats, along: Floats, width: float, rng: Rng) -> None:
    """Add a flight of steps: risers parallel to one another, a step apart."""
    across = np.array([-along[1], along[0]])
    rise, depth = rng.uniform(0.14, 0.2), rng.uniform(0.26, 0.34)
    heading = float(np.arctan2(along[1], along[0]))
    for step in range(int(rng.integers(4, 14))):
        centre = start + (step + 0.5) * depth * along + 0.5 * width * across
        add_box(builder, centre, (0.5 * depth, 0.5 * width), (step * rise, (step + 1) * rise), heading)


def add_rounds(builder: SceneBuilder, area: Rect, height: float, start: tuple[float, float], rng: Rng) -> None:
    """Add columns or trunks, tanks, and pipes along a side: true cylinders; none where sensors start.

    Whatever is drawn for them changes nothing else of a world.
    """
    own = rng.spawn(1)[0]
    tall = min(height, 8.0)
    sizes = {
        "column": ((0.15, 0.8), (tall, tall)),
        "tank": ((0.5, 2.5), (1.0, 5.0)),
        "pipe": ((0.06, 0.2), (1.5, tall)),
    }
    for kind in own.choice(list(sizes), own.poisson(1.0)):
        (thin, thick), (low, high) = sizes[kind]
        radius, top = float(np.exp(own.uniform(np.log(thin), np.log(thick)))), min(float(own.uniform(low, high)), tall)
        first, n = _place(area, own, radius + 0.2), int(own.integers(1, 5))
        if kind == "pipe":
            first[1] = area[1] + radius + own.uniform(0.02, 0.3)
        step = max(own.uniform(2.5, 5.0) * radius, 2.0 * radius + 0.05) if kind == "pipe" else own.uniform(3.0, 6.0)
        for place in first + step * np.arange(n)[:, None] * np.array([1.0, 0.0]):
            if place[0] < area[2] - radius and np.hypot(*(place - start)) > radius + 1.5:
                builder.post(place, radius, (0.0, top))


def _place(area: Rect, rng: Rng, margin: float = 0.8) -> Floats:
    low, high = np.array(area[:2]) + margin, np.array(area[2:]) - margin
    return np.asarray(rng.uniform(np.minimum(low, high), np.maximum(low, high)))


# Indoors.


def add_front(builder: SceneBuilder, area: Rect, side: int, rng: Rng, height: float) -> None:
    """Add what stands before one wall of a room: a cladding or gallery, cupboards and shelves, or radiators."""
    corners = np.array([area[:2], (area[2], area[1]), area[2:], (area[0], area[3])])
    a, b = corners[side], corners[(side + 1) % 4]
    length = float(np.hypot(*(b - a)))
    along = (b - a) / length
    inward = np.array([-along[1], along[0]])
    choice = rng.random()
    if choice < 0.2 and length > 2.0:
        begin, end = np.sort(rng.uniform(0.0, length, 2))
        gap, low = rng.uniform(0.3, 0.6), float(rng.choice([0.0, 0.0, rng.uniform(2.0, 3.0)]))
        z = (low, min(low + rng.uniform(1.0, 3.0), height - 0.1))
        if end - begin > 1.0 and z[1] > z[0] + 0.3:
            ends = a + begin * along + gap * inward, a + end * along + gap * inward
            add_wall(builder, *ends, z, rng.uniform(0.02, 0.1), drawn_openings(rng, end - begin, z[1], 0.2, False))
        return
    place = rng.uniform(0.2, 2.0)
    while choice < 0.7 and place < length - 1.2:
        width, deep, tall = rng.uniform(0.5, 2.0), rng.uniform(0.15, 0.6), rng.uniform(0.5, 2.2)
        gap = rng.choice([0.02, rng.uniform(0.1, 0.6)])
        if place + width < length - 0.9:
            centre = a + (place + 0.5 * width) * along + (gap + 0.5 * deep) * inward
            heading = float(np.arctan2(along[1], along[0]))
            add_box(builder, centre, (0.5 * width, 0.5 * deep), (0.0, min(tall, height - 0.1)), heading)
        place += width + rng.choice([0.02, rng.uniform(0.2, 3.0)])


def furnish(builder: SceneBuilder, area: Rect, height: float, rng: Rng) -> None:
    """Add what stands in one room."""
    width, depth = area[2] - area[0], area[3] - area[1]
    for side in range(4):
        if rng.random() < 0.75:
            add_front(builder, area, side, rng, height)
    if min(width, depth) < 2.6:
        return
    for _ in range(rng.poisson(min(0.06 * width * depth, 24.0))):
        turn = float(rng.choice([0.0, 0.5 * np.pi, rng.uniform(0.0, np.pi)]))
        choice, place = rng.random(), _place(area, rng)
        if choice < 0.5:
            add_table(builder, place, turn, rng)
        elif choice < 0.7:
            half = (rng.uniform(0.2, 1.0), rng.uniform(0.15, 0.5))
            add_box(builder, place, half, (0.0, rng.uniform(0.5, 2.0)), turn)
        elif choice < 0.85:
            add_plant(builder, place, rng)
        else:
            low = rng.uniform(1.0, 1.5)
            ends = place, place + rng.uniform(0.8, 2.0) * np.array([np.cos(turn), np.sin(turn)])
            add_wall(builder, *ends, (0.1, low + 0.4), rng.uniform(0.03, 0.08), ())
    if width * depth > 80.0 and rng.random() < 0.7:
        _add_pillars(builder, area, height, rng)
    if rng.random() < 0.5:
        _add_level_ones(builder, area, height, rng)


def _add_level_ones(builder: SceneBuilder, area: Rect, height: float, rng: Rng) -> None:
    """Add what lies close to a floor or a ceiling: carpets and platforms, panels, lamps and ducts."""
    for _ in range(int(rng.integers(1, 4))):
        place, turn = _place(area, rng), float(rng.choice([0.0, 0.0, rng.uniform(0.0, np.pi)]))
        half = (rng.uniform(0.4, 2.5), rng.uniform(0.3, 1.5))
        choice = rng.random()
        if choice < 0.35:
            add_slab(builder, place, half, rng.uniform(0.005, 0.03), turn)
        elif choice < 0.55:
            add_box(builder, place, half, (0.0, rng.uniform(0.08, 0.4)), turn)
        elif choice < 0.8:
            drop = rng.uniform(0.05, 0.5)
            add_box(builder, place, half, (height - drop - rng.uniform(0.02, 0.1), height - drop), turn)
        else:
            duct = (0.5 * (area[2] - area[0]), rng.uniform(0.15, 0.4))
            middle = np.array([0.5 * (area[0] + area[2]), place[1]])
            drop = rng.uniform(0.02, 0.4)
            add_box(builder, middle, duct, (height - drop - rng.uniform(0.2, 0.5), height - drop))


def add_slab(builder: SceneBuilder, centre: Floats, half: tuple[float, float], z: float, heading: float = 0.0) -> None:
    """Add a level rectangle that is seen from above alone: a carpet, a slab."""
    c, s = np.cos(heading), np.sin(heading)
    one, other = half[0] * np.array([c, s, 0.0]), half[1] * np.array([-s, c, 0.0])
    builder.sheet(np.array([*centre, z]) - one - other, 2.0 * one, 2.0 * other, Kind.GROUND)


def _add_pillars(builder: SceneBuilder, area: Rect, height: float, rng: Rng) -> None:
    pitch, half, is_round = rng.uniform(3.0, 7.0), rng.uniform(0.12, 0.4), rng.random() < 0.4
    for x in np.arange(area[0] + 0.5 * pitch, area[2] - 1.0, pitch):
        for y in np.arange(area[1] + 0.5 * pitch, area[3] - 1.0, pitch):
            place = np.array([x, y])
            if is_round:
                builder.post(place, half, (0.0, height))
            else:
                add_box(builder, place, (half, half), (0.0, height))


def divide(builder: SceneBuilder, area: Rect, height: float, rng: Rng, smallest: float) -> list[Rect]:
    """Divide an area by partitions until rooms are about `smallest` square metres, and return the rooms."""
    width, depth = area[2] - area[0], area[3] - area[1]
    if width * depth < smallest * rng.uniform(0.8, 2.0) or max(width, depth) < 5.0:
        return [area]
    axis = 0 if width > depth else 1
    cut = area[axis] + rng.uniform(0.3, 0.7) * max(width, depth)
    thickness = rng.uniform(0.05, 0.3)
    a, b = np.array(area[:2]), np.array(area[2:])
    a[axis] = b[axis] = cut
    if rng.random() < 0.15:
        b[axis] += rng.uniform(-1.0, 1.0)
    tall = height if height < 4.0 or rng.random() < 0.5 else rng.uniform(2.2, height)
    length = float(np.hypot(*(b - a)))
    openings = drawn_openings(rng, length, tall, rng.uniform(0.3, 0.8))
    if not any(low == 0.0 for _, _, low, _ in openings):
        begin = rng.uniform(0.3, length - 1.5)
        openings = [(begin, begin + 1.0, 0.0, min(2.1, tall - 0.1))]
    if rng.random() < 0.3:
        b, length = b - 0.3 * (b - a), 0.7 * length
        openings = [hole for hole in openings if hole[1] < length]
    add_wall(builder, a, b, (0.0, tall), thickness, openings)
    along = (b - a) / length
    for begin, end, low, high in openings:
        if low > 0.0:
            add_glass(builder, a + begin * along, a + end * along, (low, high))
    if rng.random() < 0.6:
        add_wings(builder, a, b, openings, rng)
    margin = 0.5 * thickness
    first = list(area)
    second = list(area)
    first[axis + 2], second[axis] = cut - margin, cut + margin
    halves = [(q[0], q[1], q[2], q[3]) for q in (first, second)]
    return [room for half in halves for room in divide(builder, half, height, rng, smallest)]


def add_shell(builder: SceneBuilder, area: Rect, height: float, rng: Rng) -> None:
    """Add the outer walls of a building, with windows, niches and a gate, its floor and its ceiling."""
    corners = [np.array(area[:2]), np.array((area[2], area[1])), np.array(area[2:]), np.array((area[0], area[3]))]
    thickness, share = rng.uniform(0.15, 0.5), rng.uniform(0.0, 0.8)
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        along = (b - a) / np.hypot(*(b - a))
        outward = np.array([along[1], -along[0]])
        openings = drawn_openings(rng, float(np.hypot(*(b - a))), height, share, floor=rng.random() < 0.3)
        middle = 0.5 * thickness * outward
        add_wall(builder, a + middle, b + middle, (0.0, height), thickness, openings)
        for begin, end, low, high in openings:
            deep = rng.uniform(0.05, 0.9) * thickness * outward
            ends = a + begin * along + deep, a + end * along + deep
            if rng.random() < 0.4:
                builder.wall(*ends, (low, high), Kind.SIDE_WALL)
            else:
                add_glass(builder, *ends, (low, high))
    sides = np.array([area[2] - area[0], 0.0, 0.0]), np.array([0.0, area[3] - area[1], 0.0])
    builder.sheet(np.array([*area[:2], height]), *sides, Kind.ROOF)
    if rng.random() < 0.5:
        drop = rng.uniform(0.1, 0.5)
        for x in np.arange(area[0] + 2.0, area[2] - 1.0, rng.uniform(2.0, 6.0)):
            ends = np.array([x, area[1]]), np.array([x, area[3]])
            add_wall(builder, *ends, (height - drop, height), rng.uniform(0.1, 0.4), ())


def _add_outside(builder: SceneBuilder, area: Rect, rng: Rng) -> None:
    """Add houses that are seen through the windows."""
    away = rng.uniform(8.0, 25.0)
    line = Line.facing(np.array([area[0], area[3] + away]), np.array([area[2], area[3] + away]), np.array([0.0, 1.0]))
    add_building(builder, line, 8.0, rng.uniform(6.0, 12.0), (False, False), rng)
    for _ in range(3):
        add_tree(builder, np.array([rng.uniform(area[0], area[2]), area[1] - rng.uniform(3.0, 9.0)]), 0.0, rng)


Built = tuple[Rect, tuple[float, float], float, float]
"""Where sensors may be, a place in it, slope of the ground along x, and height of the rooms."""


def build_hall(builder: SceneBuilder, rng: Rng) -> Built:
    """Build a hall: high, with few partitions, gates, galleries and pillars."""
    area = (0.0, 0.0, rng.uniform(16.0, 55.0), rng.uniform(12.0, 32.0))
    height = rng.uniform(3.5, 9.0)
    add_shell(builder, area, height, rng)
    rooms = divide(builder, area, height, rng, rng.uniform(60.0, 400.0))
    _finish_rooms(builder, area, rooms, height, rng)
    if rng.random() < 0.5:
        add_steps(builder, np.array([2.0, 0.1]), np.array([1.0, 0.0]), rng.uniform(1.0, 2.5), rng)
    start = _middle(max(rooms, key=_size))
    add_rounds(builder, area, height, start, rng)
    return area, start, 0.0, height


def build_office(builder: SceneBuilder, rng: Rng) -> Built:
    """Build an office floor: many rooms with doors, some of them open to each other."""
    area = (0.0, 0.0, rng.uniform(16.0, 42.0), rng.uniform(10.0, 26.0))
    height = rng.uniform(2.4, 3.4)
    add_shell(builder, area, height, rng)
    rooms = divide(builder, area, height, rng, rng.uniform(10.0, 40.0))
    _finish_rooms(builder, area, rooms, height, rng)
    return area, _middle(max(rooms, key=_size)), 0.0, height


def build_corridors(builder: SceneBuilder, rng: Rng) -> Built:
    """Build a corridor that goes round a core, with rooms on both sides."""
    deep, wide, height = rng.uniform(3.5, 6.5), rng.uniform(1.5, 3.0), rng.uniform(2.4, 3.6)
    core = rng.uniform(6.0, 26.0), rng.uniform(4.0, 14.0)
    ring = deep, deep, deep + core[0] + 2.0 * wide, deep + core[1] + 2.0 * wide
    area = (0.0, 0.0, ring[2] + deep, ring[3] + deep)
    add_shell(builder, area, height, rng)
    inner = (ring[0] + wide, ring[1] + wide, ring[2] - wide, ring[3] - wide)
    rooms = divide(builder, inner, height, rng, rng.uniform(15.0, 80.0))
    for loop, share in ((ring, rng.uniform(0.5, 1.0)), (inner, rng.uniform(0.2, 0.8))):
        corners = [np.array(q) for q in (loop[:2], (loop[2], loop[1]), loop[2:], (loop[0], loop[3]))]
        thickness = rng.uniform(0.06, 0.25)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            openings = drawn_openings(rng, float(np.hypot(*(b - a))), height, share)
            add_wall(builder, a, b, (0.0, height), thickness, openings)
    for strip, axis in (
        ((0.0, 0.0, area[2], deep - 0.15), 0),
        ((0.0, ring[3] + 0.15, area[2], area[3]), 0),
        ((0.0, deep + 0.15, deep - 0.15, ring[3] - 0.15), 1),
        ((ring[2] + 0.15, deep + 0.15, area[2], ring[3] - 0.15), 1),
    ):
        rooms += _cells(builder, strip, axis, height, rng)
    _finish_rooms(builder, area, rooms, height, rng)
    return area, (ring[0] + 0.5 * wide, ring[1] + 0.5 * wide), 0.0, height


def _cells(builder: SceneBuilder, strip: Rect, axis: int, height: float, rng: Rng) -> list[Rect]:
    """Cut a strip into rooms, one beside the other."""
    rooms, place = [], strip[axis]
    while place < strip[axis + 2] - 1.0:
        end = min(place + rng.uniform(2.4, 7.0), strip[axis + 2])
        room = list(strip)
        room[axis], room[axis + 2] = place, end
        rooms.append((room[0], room[1], room[2], room[3]))
        if end < strip[axis + 2]:
            a, b = np.array(strip[:2]), np.array(strip[2:])
            a[axis] = b[axis] = end
            add_wall(builder, a, b, (0.0, height), rng.uniform(0.05, 0.25), ())
        place = end + 0.13
    return rooms


def _finish_rooms(builder: SceneBuilder, area: Rect, rooms: Sequence[Rect], height: float, rng: Rng) -> None:
    for room in rooms:
        if rng.random() < 0.85:
            furnish(builder, room, height, rng)
    for _ in range(int(rng.integers(0, 8))):
        add_person(builder, area, rng)
    if rng.random() < 0.5:
        _add_outside(builder, area, rng)


def _size(area: Rect) -> float:
    return (area[2] - area[0]) * (area[3] - area[1])


def _middle(area: Rect) -> tuple[float, float]:
    return 0.5 * (area[0] + area[2]), 0.5 * (area[1] + area[3])


# Outdoors.


def add_ground(builder: SceneBuilder, area: Rect, slope: float) -> None:
    """Add ground that rises along x; level ground is that of the scene."""
    if slope > 0.0:
        length = area[2] - area[0]
        sides = np.array([length, 0.0, slope * length]), np.array([0.0, area[3] - area[1], 0.0])
        builder.sheet(np.array([area[0], area[1], 0.0]), *sides, Kind.GROUND)


def add_row(builder: SceneBuilder, row: Line, base: Callable[[Floats], float], rng: Rng) -> None:
    """Add houses, yards and gardens along one side of a street, whose fronts are staggered, and what is before them."""
    place, stagger, height = rng.uniform(0.0, 2.0), rng.choice([0.0, 0.4, 2.5]), rng.uniform(4.0, 14.0)
    while place < row.length - 4.0:
        length = min(rng.uniform(5.0, 22.0), row.length - place)
        lot = row.piece(place, place + length).shifted(float(rng.uniform(0.0, stagger)))
        level = base(0.5 * (lot.start + lot.end))
        choice = rng.random()
        if choice < 0.62:
            _add_house(builder, lot, level, height * rng.uniform(0.8, 1.25), rng)
        elif choice < 0.7 and length > 7.0:
            add_yard(builder, lot, rng.uniform(8.0, 14.0), rng)
        elif choice < 0.92:
            _add_garden(builder, lot, level, rng)
        else:
            _add_archway(builder, lot, level, height, rng)
        place += length + rng.choice([0.0, 0.0, rng.uniform(0.8, 5.0)])
    _add_roadside(builder, row, base, rng)


def _add_house(builder: SceneBuilder, lot: Line, level: float, height: float, rng: Rng) -> None:
    turn = rng.choice([0.0, 0.0, rng.normal(0.0, 0.04)])
    front = Line.facing(lot.start, lot.end + np.clip(turn, -0.1, 0.1) * lot.length * lot.inward, lot.inward)
    if rng.random() < 0.2:
        deep = rng.uniform(0.25, 0.6)
        cut = rng.uniform(0.3, 0.7) * front.length
        add_building(builder, front.piece(0.0, cut), 9.0, level + height, (False, False), rng)
        front = front.piece(cut, front.length).shifted(deep)
    add_building(builder, front, rng.uniform(6.0, 14.0), level + height, (rng.random() < 0.5, rng.random() < 0.5), rng)
    choice = rng.random()
    if choice < 0.25:
        add_balconies(builder, front, level + height, rng)
    elif choice < 0.4:
        add_hedge(builder, front, rng)
    elif choice < 0.6:
        fence = front.shifted(-rng.uniform(0.6, 2.5))
        z = (0.0, level + rng.uniform(0.5, 1.6))
        add_wall(builder, fence.start, fence.end, z, rng.uniform(0.03, 0.3), [(1.0, 2.2, 0.0, z[1] - 0.01)])


def _add_garden(builder: SceneBuilder, lot: Line, level: float, rng: Rng) -> None:
    """Add a garden wall, fence or railing that is seen from both sides, with what is in the garden."""
    top = level + rng.uniform(0.7, 2.4)
    gate = rng.uniform(0.5, max(0.6, lot.length - 3.5))
    if rng.random() < 0.7:
        openings = [(gate, gate + rng.uniform(1.0, 3.0), 0.0, top - 0.01)]
        add_wall(builder, lot.start, lot.end, (0.0, top), rng.uniform(0.08, 0.4), openings)
    else:
        pitch = rng.uniform(0.12, 0.3)
        for way in np.arange(0.0, lot.length, pitch):
            builder.post(lot.start + way * lot.along, 0.02, (level, top), Kind.RAILING)
        builder.wall(lot.start, lot.end, (top - 0.08, top), Kind.RAILING)
        builder.wall(lot.start, lot.end, (0.0, level + rng.uniform(0.1, 0.5)), Kind.RAILING)
    back = lot.shifted(rng.uniform(6.0, 10.0))
    builder.wall(back.start, back.end, (0.0, level + rng.uniform(3.0, 8.0)), Kind.SIDE_WALL)
    for side in (lot.start, lot.end):
        end = side + rng.uniform(3.0, 6.0) * lot.inward
        add_wall(builder, side, end, (0.0, top), rng.uniform(0.1, 0.3), ())
    for _ in range(int(rng.integers(0, 3))):
        inside = lot.start + rng.uniform(1.0, lot.length - 1.0) * lot.along + rng.uniform(2.0, 5.0) * lot.inward
        add_tree(builder, inside, level, rng)
    for _ in range(int(rng.integers(0, 6))):
        inside = lot.start + rng.uniform(1.0, lot.length - 1.0) * lot.along + rng.uniform(1.0, 8.0) * lot.inward
        add_grass(builder, inside, level, rng)
    if rng.random() < 0.5 and lot.length > 8.0:
        add_shed(builder, lot.shifted(3.0).piece(1.0, lot.length - 1.0), rng)


def _add_archway(builder: SceneBuilder, lot: Line, level: float, height: float, rng: Rng) -> None:
    """Add a house with a passage through it, whose walls go on behind."""
    width = min(rng.uniform(2.2, 4.5), lot.length - 2.0)
    begin = rng.uniform(0.8, max(0.9, lot.length - width - 0.8))
    opening = (begin, begin + width, 0.0, level + rng.uniform(2.6, 4.0))
    thick = rng.uniform(0.3, 0.8)
    top = level + max(height, 5.0)
    add_wall(builder, lot.start, lot.end, (0.0, top), thick, [opening])
    add_wings(builder, lot.start, lot.end, [opening], rng)
    back = lot.shifted(rng.uniform(5.0, 10.0))
    add_wall(builder, back.start, back.end, (0.0, top), thick, [opening])


def _add_roadside(builder: SceneBuilder, row: Line, base: Callable[[Floats], float], rng: Rng) -> None:
    """Add a kerb, parked vehicles, trees, lamps and boxes along a row, on the side of the street."""
    kerb = row.shifted(-rng.uniform(1.5, 3.0))
    if base(row.start) == base(row.end):
        rise = rng.uniform(0.08, 0.18)
        builder.wall(kerb.start, kerb.end, (0.0, rise), Kind.KERB)
        sides = np.array([*(row.start - kerb.start), 0.0]), np.array([*(kerb.end - kerb.start), 0.0])
        builder.sheet(np.array([*kerb.start, rise]), *sides, Kind.GROUND)
    heading, share, place = float(np.arctan2(row.along[1], row.along[0])), rng.uniform(0.0, 0.8), 3.0
    while place < row.length - 5.0:
        where = row.start + place * row.along
        if rng.random() < share:
            spot = where - (rng.uniform(0.95, 1.25) - (kerb.start - row.start) @ row.inward) * row.inward
            add_vehicle(builder, spot, heading + np.clip(rng.normal(0.0, 0.03), -0.1, 0.1), base(where), rng)
        elif rng.random() < 0.3:
            add_tree(builder, where - rng.uniform(0.8, 1.4) * row.inward, base(where), rng)
        elif rng.random() < 0.3:
            builder.post(where - 0.9 * row.inward, 0.07, (0.0, base(where) + rng.uniform(3.0, 7.0)))
        place += rng.uniform(5.0, 9.0)


def build_street(builder: SceneBuilder, rng: Rng) -> Built:
    """Build a street, level or rising, that may be closed at one end."""
    length, width = rng.uniform(60.0, 140.0), rng.uniform(9.0, 20.0)
    slope = float(rng.choice([0.0, rng.uniform(0.005, LONGEST_SLOPE)]))
    add_ground(builder, (0.0, -25.0, length + 12.0, width + 25.0), slope)

    def base(xy: Floats) -> float:
        return slope * max(float(xy[0]), 0.0)

    turn = rng.normal(0.0, 0.04)
    south = Line.facing(np.zeros(2), np.array([length, turn * length]), np.array([0.0, -1.0]))
    north = Line.facing(np.array([0.0, width]), np.array([length, width + turn * length]), np.array([0.0, 1.0]))
    for row in (south, north):
        add_row(builder, row, base, rng)
    if rng.random() < 0.4:
        end = Line.facing(np.array([length + 8.0, -4.0]), np.array([length + 8.0, width + 4.0]), np.array([1.0, 0.0]))
        add_row(builder, end, base, rng)
    _add_walkers(builder, (0.0, 0.0, length, width), rng)
    start = (3.0, 0.5 * width)
    add_rounds(builder, (0.0, 0.5, length, width - 0.5), np.inf, start, rng)
    return (0.0, 1.0, length, width - 1.0), start, slope, np.inf


def build_block(builder: SceneBuilder, rng: Rng) -> Built:
    """Build streets round a block, with houses on both sides."""
    core, width = np.array([rng.uniform(25.0, 45.0), rng.uniform(20.0, 35.0)]), rng.uniform(8.0, 14.0)
    low, high = np.zeros(2), core
    outer = low - width, high + width
    for corners, sign in (((low, high), 1.0), (outer, -1.0)):
        loop = [np.array([corners[i][0], corners[j][1]]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        for a, b in zip(loop, loop[1:] + loop[:1], strict=True):
            along = (b - a) / np.hypot(*(b - a))
            inward = sign * np.array([-along[1], along[0]])
            inset = 9.0 if sign > 0.0 else 0.0
            row = Line.facing(a + inset * along, b - inset * along, inward)
            add_row(builder, row, lambda xy: 0.0, rng)
    area = (*(low - width + 1.0), *(high + width - 1.0))
    _add_walkers(builder, area, rng)
    return area, (-0.5 * width, -0.5 * width), 0.0, np.inf


def build_quad(builder: SceneBuilder, rng: Rng) -> Built:
    """Build a courtyard: long walls of stone or with windows, buttresses, niches, a gate, trees and benches."""
    size = np.array([rng.uniform(18.0, 60.0), rng.uniform(15.0, 45.0)])
    askew = rng.choice([0.0, 1.5])
    corners = [place + askew * rng.uniform(-1.0, 1.0, 2) for place in size * ((0, 0), (1, 0), (1, 1), (0, 1))]
    height, stone = rng.uniform(5.0, 14.0), rng.uniform(0.0, 1.0)
    windows = draw_windows(rng)
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        along = (b - a) / np.hypot(*(b - a))
        line = Line.facing(a, b, np.array([along[1], -along[0]]))
        if rng.random() < stone:
            _add_stone_wall(builder, line, height if rng.random() < 0.7 else rng.uniform(2.0, 4.0), rng)
        else:
            add_facade(builder, line, (0.0, height), windows, rng)
            back = line.shifted(rng.uniform(4.0, 8.0))
            builder.wall(back.start, back.end, (0.0, height), Kind.SIDE_WALL)
        if rng.random() < 0.35:
            _add_arcade(builder, line.shifted(-rng.uniform(1.8, 3.0)), rng)
    for _ in range(int(rng.integers(0, 10))):
        add_tree(builder, _place((0.0, 0.0, *size), rng, 3.0), 0.0, rng)
    for _ in range(int(rng.integers(0, 8))):
        add_grass(builder, _place((0.0, 0.0, *size), rng, 3.0), 0.0, rng)
        half = (rng.uniform(1.0, 6.0), rng.uniform(0.5, 3.0))
        add_slab(builder, _place((0.0, 0.0, *size), rng, 5.0), half, rng.uniform(0.02, 0.2), rng.uniform(0.0, 3.0))
    for _ in range(int(rng.integers(4, 24))):
        half = (rng.uniform(0.4, 2.0), rng.uniform(0.2, 0.8))
        add_box(builder, _place((0.0, 0.0, *size), rng, 2.0), half, (0.0, rng.uniform(0.4, 1.8)), rng.uniform(0.0, 3.0))
    for _ in range(int(rng.integers(1, 6))):
        place = _place((0.0, 0.0, *size), rng, 6.0)
        ends = place, place + rng.uniform(3.0, 10.0) * np.eye(2)[int(rng.integers(2))]
        add_wall(builder, *ends, (0.0, rng.uniform(0.5, 2.2)), rng.uniform(0.1, 0.5), ())
    area = (2.0, 2.0, size[0] - 2.0, size[1] - 2.0)
    _add_walkers(builder, area, rng)
    start = (0.5 * size[0], 0.5 * size[1])
    add_rounds(builder, area, np.inf, start, rng)
    return area, start, 0.0, np.inf


def _add_stone_wall(builder: SceneBuilder, line: Line, height: float, rng: Rng) -> None:
    """Add a thick wall with gates, niches and buttresses."""
    thick = rng.uniform(0.3, 1.0)
    holes = drawn_openings(rng, line.length, height, rng.uniform(0.3, 0.9))
    middle = line.shifted(0.5 * thick)
    add_wall(builder, middle.start, middle.end, (0.0, height), thick, holes)
    add_wings(builder, middle.start, middle.end, [hole for hole in holes if rng.random() < 0.4], rng)
    for begin, end, low, high in holes:
        if low > 0.0 or rng.random() < 0.4:
            pane = line.piece(begin, end).shifted(rng.uniform(0.2, 0.9) * thick)
            builder.wall(pane.start, pane.end, (low, high), Kind.SIDE_WALL)
    if rng.random() < 0.5:
        deep, half, pitch = rng.uniform(0.2, 0.7), rng.uniform(0.2, 0.6), rng.uniform(3.0, 8.0)
        heading = float(np.arctan2(line.along[1], line.along[0]))
        for way in np.arange(0.5 * pitch, line.length - 1.0, pitch):
            place = line.start + way * line.along - 0.5 * deep * line.inward
            add_box(builder, place, (half, 0.5 * deep), (0.0, height * rng.uniform(0.5, 0.95)), heading)


def _add_arcade(builder: SceneBuilder, line: Line, rng: Rng) -> None:
    """Add a wall of arches on pillars before a wall, with the roof between them left out."""
    pitch, pier, top = rng.uniform(2.4, 4.0), rng.uniform(0.4, 0.9), rng.uniform(3.2, 4.5)
    inner = line.piece(3.5, line.length - 3.5) if line.length > 12.0 else line
    arches = [(way + pier, way + pitch, 0.0, top - 0.6) for way in np.arange(0.0, inner.length - pitch, pitch)]
    add_wall(builder, inner.start, inner.end, (0.0, top), rng.uniform(0.3, 0.6), arches)


def _add_walkers(builder: SceneBuilder, area: Rect, rng: Rng) -> None:
    for _ in range(int(rng.integers(0, 10))):
        add_person(builder, area, rng)


SITES: dict[str, Callable[[SceneBuilder, Rng], Built]] = {
    "hall": build_hall,
    "office": build_office,
    "corridors": build_corridors,
    "street": build_street,
    "block": build_block,
    "quad": build_quad,
}
