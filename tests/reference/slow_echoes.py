"""Mirror echoes of one transducer by images and shapely: one wall, two walls, and a wall that shows another."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.special import fresnel

from prf.simulate.sonar import MIRROR_LEVEL
from prf.simulate.sonar_physics import SonarPhysics

Floats = NDArray[np.float64]

INSIDE = 1e-4
"""Metres from a wall's end at which something at that end is looked for."""
FARTHEST = 30.0
"""Fresnel argument beyond which what fades over an end is nothing."""


def slow_mirror_echoes(walls: Floats, place: Floats, heading: float, physics: SonarPhysics) -> Floats:
    """Return range and level (n, 2) of every mirror echo; no corners, edges or rough walls."""
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    axis = np.array([math.cos(heading), math.sin(heading)])
    found = [one_wall(walls, lines, w, place, axis, physics, None) for w in range(len(walls))]
    for one, two in permutations(range(len(walls)), 2):
        found.append(one_wall(walls, lines, two, place, axis, physics, one))
        found.append(two_walls(walls, lines, one, two, place, axis, physics))
    return np.array([echo for echo in found if echo is not None]).reshape(-1, 2)


def one_wall(
    walls: Floats, lines: Floats, w: int, place: Floats, axis: Floats, physics: SonarPhysics, mirror: int | None
) -> tuple[float, float] | None:
    """Echo of wall `w`, as `mirror` shows it if there is one."""
    if mirror is not None and side(walls[mirror], place) <= 0.0:
        return None
    here = place if mirror is None else reflect(walls[mirror], place)
    start, along, length = frame(walls[w])
    height = side(walls[w], here)
    if height <= 0.0:
        return None
    foot = float((here - start) @ along)
    closed = [closed_end(walls, w, end) for end in (0, 1)]
    if (foot < 0.0 and closed[0]) or (foot > length and closed[1]):
        return None
    v = [2.0 * math.sqrt(2.0 * (math.hypot(foot - end, height) - height) / physics.wavelength) for end in (0, length)]
    first = -np.inf if closed[0] else math.copysign(v[0], -foot)
    last = np.inf if closed[1] else math.copysign(v[1], length - foot)
    share = abs(fresnel_share(first, last)) if first < FARTHEST and last > -FARTHEST else 0.0
    point = start + np.clip(foot, INSIDE, length - INSIDE) * along
    if mirror is None:
        legs, skips, toward, bounces = [(place, point)], [{w}], point, 1
    else:
        on_mirror = meeting(walls[mirror], here, point)
        if on_mirror is None:
            return None
        legs, skips = [(place, on_mirror), (on_mirror, point)], [{mirror}, {mirror, w}]
        toward, bounces = on_mirror, 3
    if not all(free(lines, leg, skip) for leg, skip in zip(legs, skips, strict=True)):
        return None
    way = 2.0 * float(np.hypot(*(point - here)))
    size = physics.mirror**bounces / way * share * beam(physics, place, axis, toward) ** 2
    return 0.5 * way, level(physics, size, way)


def two_walls(
    walls: Floats, lines: Floats, one: int, two: int, place: Floats, axis: Floats, physics: SonarPhysics
) -> tuple[float, float] | None:
    """Echo by wall `one`, then wall `two`, if they do not make a right-angled corner."""
    if corner_of(walls, one, two) or corner_of(walls, two, one) or side(walls[one], place) <= 0.0:
        return None
    first = reflect(walls[one], place)
    if side(walls[two], first) <= 0.0 or side(walls[two], place) <= 0.0:
        return None
    second = reflect(walls[two], first)
    b = meeting(walls[two], second, place)
    a = None if b is None else meeting(walls[one], first, b)
    if a is None or b is None:
        return None
    legs = [((place, a), {one}), ((a, b), {one, two}), ((b, place), {two})]
    if not all(free(lines, leg, skip) for leg, skip in legs):
        return None
    way = float(np.hypot(*(second - place)))
    out, back = beam(physics, place, axis, a), beam(physics, place, axis, b)
    if min(out, back) < MIRROR_LEVEL:
        return None
    size = physics.mirror**2 / way * out * back
    return 0.5 * way, level(physics, size, way)


def level(physics: SonarPhysics, size: float, way: float) -> float:
    return physics.level_db + 20.0 * math.log10(max(size, 1e-12)) - physics.absorption_db * way


def beam(physics: SonarPhysics, place: Floats, axis: Floats, point: Floats) -> float:
    across = point - place
    cosine = float(across @ axis) / float(np.hypot(*across))
    return float(physics.directivity(math.acos(np.clip(cosine, -1.0, 1.0)))) if cosine > 0.0 else 0.0


def fresnel_share(first: float, last: float) -> complex:
    def integral(v: float) -> complex:
        if math.isinf(v):
            return complex(0.5, 0.5) * math.copysign(1.0, v)
        sine, cosine = fresnel(v)
        return complex(cosine, sine)

    return (integral(last) - integral(first)) / (1 + 1j)


def frame(wall: Floats) -> tuple[Floats, Floats, float]:
    across = wall[2:] - wall[:2]
    length = float(np.hypot(*across))
    return wall[:2], across / length, length


def side(wall: Floats, point: Floats) -> float:
    start, along, _ = frame(wall)
    return float(along[0] * (point - start)[1] - along[1] * (point - start)[0])


def reflect(wall: Floats, point: Floats) -> Floats:
    start, along, _ = frame(wall)
    return 2.0 * (start + ((point - start) @ along) * along) - point


def meeting(wall: Floats, a: Floats, b: Floats) -> Floats | None:
    """Point at which the segment ab crosses the wall."""
    crossed = shapely.intersection(shapely.linestrings([a, b]), shapely.linestrings(wall.reshape(2, 2)))
    return None if crossed.is_empty else np.array(crossed.coords[0])


def free(lines: Floats, leg: tuple[Floats, Floats], skip: set[int]) -> bool:
    touched = np.flatnonzero(shapely.intersects(lines, shapely.linestrings(np.array(leg))))
    return set(touched.tolist()) <= skip


def corner_of(walls: Floats, before: int, after: int) -> bool:
    """Whether wall `after` starts where `before` ends, and turns left by a right angle, within 10 degrees."""
    u, v = frame(walls[before])[1], frame(walls[after])[1]
    turn = math.atan2(u[0] * v[1] - u[1] * v[0], float(u @ v))
    return bool((walls[before, 2:] == walls[after, :2]).all()) and abs(turn - 0.5 * math.pi) < math.radians(10.0)


def closed_end(walls: Floats, w: int, end: int) -> bool:
    others = (k for k in range(len(walls)) if k != w)
    return any(corner_of(walls, k, w) if end == 0 else corner_of(walls, w, k) for k in others)
