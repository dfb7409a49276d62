"""Poses of a robot over a log, and where it was at a reading that has no pose of its own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.logs.readings import FloatArray, IntArray
from prf.shell.tf import HOLD

MOST_TIES = 0.1
"""Share of equal time stamps up to which a clock is fine enough to interpolate by it."""


class Track(NamedTuple):
    """Poses of a robot, one a line of the log.

    Attributes
    ----------
    line : (n,) int64
        Line of the file, growing.
    time : (n,) float64
        Seconds.
    pose : (n, 3) float64
        Position in metres and heading in radians.
    """

    line: IntArray
    time: FloatArray
    pose: FloatArray

    @classmethod
    def from_rows(cls, rows: list[tuple[int, float, FloatArray]]) -> Track:
        """Return the track of (line, time, pose) rows, at least one."""
        line, time, pose = zip(*rows, strict=True)
        return cls(np.array(line, dtype=np.int64), np.array(time), np.array(pose))

    @property
    def has_clock(self) -> bool:
        """Whether the time stamps are fit to interpolate by: they never run backward and few are equal."""
        steps = np.diff(self.time)
        return bool(len(steps) and (steps >= 0).all() and np.count_nonzero(steps == 0) <= MOST_TIES * len(steps))


def poses_at(track: Track, line: IntArray, time: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return where the robot was at readings.

    With a fit clock the pose is interpolated between the poses before and after the reading's time stamp, linearly and
    along the shorter turn; `HOLD` seconds beyond the ends it stands. Without one it is the last pose in the file before
    the reading.

    Parameters
    ----------
    track : Track
        At least one pose.
    line : (m,) int64
        Lines of the readings.
    time : (m,) float64
        Their time stamps, finite.

    Returns
    -------
    pose : (m, 3) float64
        Heading not wrapped; where unknown, of no meaning.
    known : (m,) bool
        False for readings before the first pose or too far from the ends.
    """
    if not track.has_clock:
        before = np.searchsorted(track.line, line) - 1
        return track.pose[np.maximum(before, 0)], before >= 0
    pose = track.pose.copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    # Of equal time stamps the last pose counts.
    last = np.r_[np.diff(track.time) > 0, True]
    stamps, pose = track.time[last], pose[last]
    found = np.column_stack([np.interp(time, stamps, column) for column in pose.T])
    return found, (time >= stamps[0] - HOLD) & (time <= stamps[-1] + HOLD)


def mounted(robot: FloatArray, mount: FloatArray) -> FloatArray:
    """Return the world pose of something mounted on a robot.

    Parameters
    ----------
    robot : (3,) float64
        Pose of the robot in the world, metres and radians.
    mount : (3,) or (k, 3) float64
        Poses in the robot's frame.

    Returns
    -------
    pose : as `mount`
    """
    cosine, sine = np.cos(robot[2]), np.sin(robot[2])
    x, y = mount[..., 0], mount[..., 1]
    return np.stack(
        (robot[0] + cosine * x - sine * y, robot[1] + sine * x + cosine * y, robot[2] + mount[..., 2]), axis=-1
    )
