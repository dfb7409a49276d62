"""What sound meets in a simulated world: walls, their corners and rough patches, and whether two points see each other.

Walls have free space on their left. Nothing here is shared with the likelihood of sonar readings.
"""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import core
from prf.kernels.geometry import segments_meet
from prf.kernels.grid import Grid, walk


class EchoScene(NamedTuple):
    """Reflectors as arrays; ``n`` walls, ``k`` corners, ``m`` patches of rough walls.

    `wall` (n, 4) ends, `along` (n, 2) unit vectors from the first end to the second, `length` (n,) metres, `mirror`
    (n,) share of the amplitude that one reflection keeps, `partner` (n, 2) the wall with which it makes a
    right-angled corner of the room at either end, NO_WALL if it does not.
    `corner` (k, 2) places, `before` and `after` (k,) the walls that end and start there, `turn` (k,) radians from the
    one to the other, positive: a corner of the room, negative: an edge that sticks out.
    `patch` (m, 2) middles, `patch_wall` (m,), `patch_gain` and `patch_phase` (m,).
    `cell_start` and `cell_wall` list the walls of every cell of `grid`; `cells` is scratch of a walk through them.
    """

    wall: np.ndarray
    along: np.ndarray
    length: np.ndarray
    mirror: np.ndarray
    partner: np.ndarray
    corner: np.ndarray
    before: np.ndarray
    after: np.ndarray
    turn: np.ndarray
    patch: np.ndarray
    patch_wall: np.ndarray
    patch_gain: np.ndarray
    patch_phase: np.ndarray
    grid: Grid
    cell_start: np.ndarray
    cell_wall: np.ndarray
    cells: np.ndarray


class Ear(NamedTuple):
    """A transducer, real or mirrored: where it is, and the unit vector of its axis."""

    x: float
    y: float
    ux: float
    uy: float


NO_WALL = -1
"""In place of the index of a wall: none."""


@core
def is_clear(scene: EchoScene, ax: float, ay: float, bx: float, by: float, one: int, two: int, three: int) -> bool:
    """Whether no wall but the three to be skipped touches the segment ab."""
    n = walk(scene.grid, ax, ay, bx, by, scene.cells)
    for c in range(n):
        cell = scene.cells[c]
        for k in range(scene.cell_start[cell], scene.cell_start[cell + 1]):
            w = scene.cell_wall[k]
            if w != one and w != two and w != three:
                e = scene.wall[w]
                if segments_meet(ax, ay, bx, by, e[0], e[1], e[2], e[3]):
                    return False
    return True


@core
def height_over(scene: EchoScene, w: int, x: float, y: float) -> float:
    """Distance of a point from the line of wall `w`, positive on its free side."""
    return scene.along[w, 0] * (y - scene.wall[w, 1]) - scene.along[w, 1] * (x - scene.wall[w, 0])


@core
def place_along(scene: EchoScene, w: int, x: float, y: float) -> float:
    """Distance from the first end of wall `w` to the foot of the perpendicular from a point."""
    return scene.along[w, 0] * (x - scene.wall[w, 0]) + scene.along[w, 1] * (y - scene.wall[w, 1])


@core
def image_of(scene: EchoScene, w: int, ear: Ear) -> Ear:
    """Mirror image of a transducer in the line of wall `w`."""
    nx = -scene.along[w, 1]
    ny = scene.along[w, 0]
    twice = 2.0 * height_over(scene, w, ear.x, ear.y)
    tilt = 2.0 * (ear.ux * nx + ear.uy * ny)
    return Ear(ear.x - twice * nx, ear.y - twice * ny, ear.ux - tilt * nx, ear.uy - tilt * ny)


@core
def crossing_place(scene: EchoScene, w: int, ax: float, ay: float, bx: float, by: float) -> float:
    """Place along wall `w` at which the segment ab crosses its line, nan if it does not or beyond the wall's ends."""
    ha = height_over(scene, w, ax, ay)
    hb = height_over(scene, w, bx, by)
    if ha * hb >= 0.0:
        return math.nan
    sa = place_along(scene, w, ax, ay)
    s = sa + (place_along(scene, w, bx, by) - sa) * ha / (ha - hb)
    return s if 0.0 <= s <= scene.length[w] else math.nan


@core
def is_seen(scene: EchoScene, real: Ear, ear: Ear, mirror: int, x: float, y: float, skip: int, skip_too: int) -> bool:
    """Whether sound goes from a transducer to a point, straight or by the wall `mirror` in which `ear` is its image."""
    if mirror == NO_WALL:
        return is_clear(scene, real.x, real.y, x, y, skip, skip_too, NO_WALL)
    s = crossing_place(scene, mirror, ear.x, ear.y, x, y)
    if not s >= 0.0:
        return False
    mx = scene.wall[mirror, 0] + s * scene.along[mirror, 0]
    my = scene.wall[mirror, 1] + s * scene.along[mirror, 1]
    if not is_clear(scene, real.x, real.y, mx, my, mirror, NO_WALL, NO_WALL):
        return False
    return is_clear(scene, mx, my, x, y, mirror, skip, skip_too)
