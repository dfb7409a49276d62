"""What stands in streets: pavements, railings, garden walls, parked cars, trees, lamp posts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.simulate.kinds import Kind
from mapq.simulate.line import Line
from mapq.simulate.scene import SceneBuilder

Floats = NDArray[np.float64]

PAVEMENT = 2.2
"""Width of a pavement in metres."""

KERB = 0.12
"""Height of a kerb in metres."""


def add_pavement(builder: SceneBuilder, line: Line) -> None:
    """Add a pavement in front of a row of facades, with its kerb; it goes on behind their setbacks."""
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
    """Add a building across a pathway with an archway through it.

    Parameters
    ----------
    builder : SceneBuilder
    line : Line
        The front, across the pathway.
    depth, height : float
        Of the building, in metres.
    opening : (3,) float
        Where the archway begins and ends along the front, and its clear height.
    """
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
    """Add a pier that stands out of the front beside the opening."""
    reach = -0.45 * line.inward
    outer = foot + side * 0.7 * line.along
    for a, b in ((foot, foot + reach), (outer, outer + reach), (foot + reach, outer + reach)):
        builder.wall(a, b, (0.0, 2.6), Kind.ARCH)
