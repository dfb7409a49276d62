"""Lines of CARMEN logs with readings: laser lines, with poses or raw, and SONAR lines of both layouts.

A line holds one message, and its first field alone names it (comments may hold any of these words)::

    FLASER n r1..rn laser_x laser_y laser_theta robot_x robot_y robot_theta time host logger_time
    RLASER ...                                                                     likewise
    ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n r1..rn m s1..sm
        laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward side [turn_axis] time host logger_time
    RAWLASER1 type start_angle ... n r1..rn m s1..sm time host logger_time         as ROBOTLASER1, without poses
    SONAR cone_angle num_sonars r1..rn x1 y1 theta1 .. xn yn thetan time host logger_time
    SONAR n r1..rn x y theta odom_x odom_y odom_theta time host logger_time        as GMapping reads it
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.readings.readings import Scan
from prf.readings.robot import plain_bearings, spread
from prf.readings.text import FloatArray, expect_length, floats

PLAIN_LASERS = ("FLASER", "RLASER")
LASERS = (*PLAIN_LASERS, *(f"ROBOTLASER{i}" for i in range(6)))
DP_SLAM = "Laser"
RAW_LASERS = (*(f"RAWLASER{i}" for i in range(6)), DP_SLAM)
SONAR = "SONAR"
NOWHERE = np.zeros(3)


class LaserLine(NamedTuple):
    """One laser line: `bearing` is relative to the heading of `pose`, the laser's; `robot` is the pose of the base."""

    kind: str
    line: int
    ranges: FloatArray
    bearing: FloatArray
    pose: FloatArray
    time: float
    robot: FloatArray
    max_range: float = np.nan

    @property
    def is_return(self) -> NDArray[np.bool_]:
        """Which ranges lie below the scanner's maximum, all if there is none."""
        return np.asarray(~(self.ranges >= (self.max_range if self.max_range > 0.0 else np.inf)))

    def scan(self) -> Scan:
        """Return the beams in the world."""
        ranges = np.where(self.is_return, self.ranges, np.inf)
        return Scan(self.kind, self.line, self.time, self.pose, self.pose[:2], self.pose[2] + self.bearing, ranges)


class SonarLine(NamedTuple):
    """One SONAR line; `pose` and `ring` are None where it has none."""

    line: int
    ranges: FloatArray
    time: float
    cone: float
    pose: FloatArray | None
    ring: FloatArray | None


def parse_laser(number: int, fields: list[bytes]) -> LaserLine:
    """Return the laser line in the fields of a line (ValueError or IndexError if it is damaged)."""
    kind = fields[0].decode("ascii")
    if kind not in (*PLAIN_LASERS, DP_SLAM):
        return _parse_robot_laser(kind, number, fields)
    n = int(fields[1])
    if kind == DP_SLAM:
        expect_length(fields, (n + 2,), f"{n} readings")
        return LaserLine(kind, number, floats(fields[2:]), plain_bearings(n), NOWHERE, np.nan, NOWHERE)
    expect_length(fields, (n + 11,), f"{n} readings")
    values = floats(fields[2 : n + 9])
    return LaserLine(
        kind, number, values[:n], plain_bearings(n), values[n : n + 3], float(values[-1]), values[n + 3 : n + 6]
    )


def _parse_robot_laser(kind: str, number: int, fields: list[bytes]) -> LaserLine:
    n = int(fields[8])
    m = int(fields[n + 9])
    start, _, step, max_range = floats(fields[2:6]).tolist()
    ranges = floats(fields[9 : n + 9])
    if kind in RAW_LASERS:
        expect_length(fields, (n + m + 13,), f"{n} readings and {m} remission values")
        return LaserLine(kind, number, ranges, spread(start, step, n), NOWHERE, float(fields[-3]), NOWHERE, max_range)
    # The format page of CARMEN has turn_axis, some writers of the format leave it out.
    expect_length(fields, (n + m + 24, n + m + 23), f"{n} readings and {m} remission values")
    poses = floats(fields[n + m + 10 : n + m + 16])
    return LaserLine(kind, number, ranges, spread(start, step, n), poses[:3], float(fields[-3]), poses[3:], max_range)


def parse_sonar(number: int, fields: list[bytes], cone: float) -> SonarLine:
    """Return the SONAR line in the fields of a line, likewise; `cone` where it has none."""
    has_pose = fields[1].isdigit()
    n = int(fields[1] if has_pose else fields[2])
    expect_length(fields, (n + 11 if has_pose else 4 * n + 6,), f"{n} readings")
    time = float(fields[-3])
    if has_pose:
        values = floats(fields[2 : n + 5])
        return SonarLine(number, values[:n], time, cone, values[n:], None)
    values = floats(fields[3:-3])
    return SonarLine(number, values[:n], time, float(fields[1]) or cone, None, values[n:].reshape(n, 3))
