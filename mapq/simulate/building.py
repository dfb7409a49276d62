"""Office buildings: where facades and blank walls stand, with setbacks of upper storeys."""

from __future__ import annotations

import numpy as np

from mapq.simulate.facade import add_facade, draw_windows
from mapq.simulate.kinds import Kind
from mapq.simulate.line import Line
from mapq.simulate.scene import SceneBuilder


def add_building(
    builder: SceneBuilder,
    front: Line,
    depth: float,
    height: float,
    open_sides: tuple[bool, bool],
    rng: np.random.Generator,
) -> tuple[int | None, int | None]:
    """Add a building behind its front line, and return the surfaces of its two blank side walls, None for an open one.

    Parameters
    ----------
    builder : SceneBuilder
    front : Line
    depth, height : float
        In metres.
    open_sides : pair of bool
        Whether the side at the line's start, and at its end, faces a street and has windows.
    rng : Generator
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
