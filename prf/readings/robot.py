"""What a robot carries: where its sensors sit on it, rings of sonars, and the directions of their beams."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from prf.readings.readings import Readings
from prf.readings.text import FloatArray
from prf.shell.errors import ConfigError, InputError

QUARTER_DEGREES = (400, 401)  # beams of a scan over 100 degrees in steps of a quarter of a degree

_LEFT_FRONT = ((0.115, 0.130, 1.5708), (0.155, 0.115, 0.8727), (0.190, 0.080, 0.5236), (0.210, 0.025, 0.1745))
_FRONT = (*_LEFT_FRONT, *((x, -y, -turn) for x, y, turn in reversed(_LEFT_FRONT)))
_BACK = tuple((-x, -y, turn - np.copysign(np.pi, turn)) for x, y, turn in _FRONT)

PIONEER = np.array((*_FRONT, *_BACK))
"""(16, 3): position in metres and heading in radians of the transducers of a Pioneer 2 on the robot, clockwise from the
left. A robot with the front array alone has the first 8. As the Player server writes them, to 0.1 mrad."""


def mounted(robot: FloatArray, mount: FloatArray) -> FloatArray:
    """Return the world pose of something mounted on a robot.

    `robot` (3,): pose of the robot in the world, metres and radians. `mount` (3,) or (k, 3): poses in the robot's
    frame.
    """
    cosine, sine = np.cos(robot[2]), np.sin(robot[2])
    x, y = mount[..., 0], mount[..., 1]
    return np.stack(
        (robot[0] + cosine * x - sine * y, robot[1] + sine * x + cosine * y, robot[2] + mount[..., 2]), axis=-1
    )


def seen_from(robot: FloatArray, pose: FloatArray) -> FloatArray:
    """Return the pose (3,) on a robot of something whose world pose is `pose`, both as :func:`mounted` has them."""
    cosine, sine = np.cos(robot[2]), np.sin(robot[2])
    x, y, turn = pose - robot
    return np.array([cosine * x + sine * y, cosine * y - sine * x, np.arctan2(np.sin(turn), np.cos(turn))])


def ring_of(n: int) -> FloatArray | None:
    """Return the (n, 3) Pioneer ring of `n` transducers, or None if there is none of that size."""
    return PIONEER[:n] if n in (8, 16) else None


def fields_of_view(readings: Readings, cone: float) -> FloatArray:
    """Return the full field of view (n,) of sonar readings, radians: the log's, or `cone` where it has none."""
    if not 0.0 < cone < np.pi:
        raise ConfigError(f"sonar cone {cone}: must lie between 0 and pi radians")
    view = np.where(readings.cone > 0.0, readings.cone, cone)
    if view.max() >= np.pi:
        raise InputError(f"{readings.source}: a sonar cone of {view.max():g} radians. It must be narrower than pi.")
    return view


def spread(start: float, step: float, n: int) -> FloatArray:
    """Return n directions from `start` on, radians (ValueError unless they differ and stay within one turn)."""
    is_scan = n < 2 or 0.0 < abs(step) * (n - 1) <= 2.0 * np.pi + min(abs(step), 1.0)
    if not (is_scan and abs(start) <= 2.0 * np.pi):
        raise ValueError(
            f"{n} beams from {start:g} in steps of {step:g} rad: expected different directions within one turn"
        )
    return np.array([start]) if n == 1 else start + step * np.arange(n, dtype=np.float64)


@lru_cache(maxsize=8)
def plain_bearings(n: int) -> FloatArray:
    """Return the (n,) bearings in radians of the beams of a line that carries none, right to left."""
    if n not in QUARTER_DEGREES:
        return half_circle(n)
    return (np.arange(n, dtype=np.float64) - 200.0) * (np.pi / 720.0)


@lru_cache(maxsize=8)
def half_circle(n: int) -> FloatArray:
    """Return the (n,) bearings in radians of a scan over half a circle, right to left, by CARMEN's convention."""
    steps = n if n in (180, 360) else max(n - 1, 1)
    return -np.pi / 2 + np.arange(n, dtype=np.float64) * (np.pi / steps)
