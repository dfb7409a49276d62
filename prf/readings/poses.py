"""Where sensors are and look: poses over a log, what is mounted on a robot, beams of a scan, rings of transducers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.readings.readings import Readings
from prf.readings.text import FloatArray, IntArray, check_domains
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.tf import HOLD

MAX_TIES = 0.1  # share of equal time stamps up to which a clock is fine enough to interpolate by it
CONE = 0.349  # radians. Full opening angle of a sonar whose log has none: 20 degrees
QUARTER_DEGREES = (400, 401)  # beams of a scan over 100 degrees in steps of a quarter of a degree

_LEFT_FRONT = ((0.115, 0.130, 1.5708), (0.155, 0.115, 0.8727), (0.190, 0.080, 0.5236), (0.210, 0.025, 0.1745))
_FRONT = (*_LEFT_FRONT, *((x, -y, -turn) for x, y, turn in reversed(_LEFT_FRONT)))
_BACK = tuple((-x, -y, turn - np.copysign(np.pi, turn)) for x, y, turn in _FRONT)

PIONEER = np.array((*_FRONT, *_BACK))
"""(16, 3): position in metres and heading in radians of the transducers of a Pioneer 2 on the robot, clockwise from the
left. A robot with the front array alone has the first 8. As the Player server writes them, to 0.1 mrad."""


class Track(NamedTuple):
    """Poses of a robot, one a line of the log."""

    name: str  # where they are from, for a person
    line: IntArray  # (n,) line of the file, growing
    time: FloatArray  # (n,) seconds
    pose: FloatArray  # (n, 3) position in metres and heading in radians

    @classmethod
    def from_rows(cls, name: str, rows: Sequence[tuple[int, float, FloatArray]], source: str) -> Track:
        """Return the track of (line, time, pose) rows, at least one."""
        line, time, pose = (np.array(column) for column in zip(*rows, strict=True))
        check_domains(source, line, {"t": time, **dict(zip(("x", "y", "theta"), pose.T, strict=True))}, nan=())
        return cls(name, line, time, pose)

    @property
    def has_clock(self) -> bool:
        """Whether the time stamps are fit to interpolate by: they never run backward and few are equal."""
        steps = np.diff(self.time)
        return bool(len(steps) and (steps >= 0).all() and np.count_nonzero(steps == 0) <= MAX_TIES * len(steps))

    @property
    def how(self) -> str:
        """How poses are found, for a person."""
        return f"{self.name}, " + ("interpolated in time" if self.has_clock else "the last one before each reading")

    def poses_at(self, line: Sequence[int], time: Sequence[float], source: str) -> tuple[FloatArray, list[str]]:
        """Return where the robot was at readings (m, 3), heading not wrapped, nan where unknown, and remarks.

        With a fit clock the pose is interpolated between the poses before and after the reading's time, linearly and
        along the shorter turn, and held for `HOLD` seconds beyond the ends. Without one it is the last pose in the file
        before the reading.
        """
        if self.has_clock:
            found, known = self._interpolated(np.array(time))
        else:
            before = np.searchsorted(self.line, line) - 1
            found, known = self.pose[np.maximum(before, 0)], before >= 0
        if not known.any():
            raise InputError(f"{source}: no reading lies within the time of the poses ({self.name}).")
        n_lost = np.count_nonzero(~known)
        lost = f"{n_lost} of {len(known)} scans lie outside the time of the poses: dropped"
        return np.where(known[:, None], found, np.nan), [lost] if n_lost else []

    def _interpolated(self, time: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        pose = self.pose.copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        # Of equal time stamps the last pose counts.
        last = np.r_[np.diff(self.time) > 0, True]
        stamps, pose = self.time[last], pose[last]
        found = np.column_stack([np.interp(time, stamps, column) for column in pose.T])
        return found, (time >= stamps[0] - HOLD) & (time <= stamps[-1] + HOLD)


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
    """Return n directions from `start` on, radians (ValueError if they are no scan)."""
    is_scan = n < 2 or 0.0 < abs(step) * (n - 1) <= 2.0 * np.pi + min(abs(step), 1.0)
    if not (is_scan and abs(start) <= 2.0 * np.pi):
        raise ValueError(f"{n} beams from {start:g} in steps of {step:g} rad are no scan")
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
