"""What else stands in real streets: lorries side by side, sheds, balconies, hedges, tanks.

True surfaces that lie near and parallel to one another at half a metre to three, which streets of offices lack, and
rough and curved ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.simulate.kinds import Kind
from mapq.simulate.line import Line
from mapq.simulate.scene import SceneBuilder

Floats = NDArray[np.float64]

YARD_CHANCE = 0.12
"""Chance that a lot has a yard in place of a building, times `variety`."""

BALCONIES_CHANCE, HEDGE_CHANCE = 0.15, 0.12
"""Chances that a building has balconies, and a hedge in front of it, times `variety`."""

SHED_CHANCE = 0.4
"""Chance of a shed or a lorry in a garden, times `variety`."""

SHORTEST_YARD = 7.0
"""Metres of frontage."""


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
    """Return the line turned by up to some degrees: nobody parks quite straight."""
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
