"""The public sets of real sonar readings, which have formats of their own, as readings.

Both are made into the text of a table first, so what comes back is what a user would get who converts them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from prf.readings import Readings
from prf.readings.table import read_table

CORRIDOR_BEARINGS = np.radians([-90, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 90])
CORRIDOR_CONE = np.radians(20.0)
CORRIDOR_NO_ECHO = 5110
"""Millimetres."""

ARENA_POSITIONS = ((84, 30), (180, 30), (180, 54), (138, 54), (138, 168))
"""Centimetres; heading 0. The robot was placed by hand: the headings are off by up to 9 degrees."""
ARENA_CONE = np.radians(30.0)
ARENA_NO_ECHO = 257.5
"""Centimetres."""
ARENA_WALLS = 0.01 * np.array(
    [
        [(0, 0), (0, 168)],
        [(0, 168), (84, 168)],
        [(84, 126), (84, 210)],
        [(84, 210), (168, 210)],
        [(168, 210), (168, 84)],
        [(168, 84), (210, 84)],
        [(210, 84), (210, 0)],
        [(210, 0), (0, 0)],
    ]
)
"""(8, 2, 2): the true walls, metres."""

Row = tuple[float, float, float, float, float, float, int]


def corridor8_readings(folder: Path) -> Readings:
    """Return the readings of an array of 8 transducers in two corridors, 413 scans.

    Millimetres, milliseconds and tenths of a degree in the files; the transducers sit at the robot's centre as far as
    one can tell.
    """
    measured = np.loadtxt(folder / "measurement.txt")
    pose = np.loadtxt(folder / "poses.txt")
    np.testing.assert_array_equal(measured[:, 0], pose[:, 0])
    rows: list[Row] = []
    for scan, ((ms, x, y, tenths), ranges) in enumerate(zip(pose, measured[:, 1:], strict=True)):
        angles = np.radians(tenths / 10) + CORRIDOR_BEARINGS
        for angle, distance in zip(angles, ranges, strict=True):
            echo = np.inf if distance >= CORRIDOR_NO_ECHO else distance / 1000
            rows.append((x / 1000, y / 1000, angle, echo, CORRIDOR_CONE, ms / 1000, scan))
    return _readings(rows, "corridor8")


def arena_readings(folder: Path) -> Readings:
    """Return the readings of one rotating sonar at five known places of a known arena, 5 scans of 180."""
    rows: list[Row] = []
    for scan, (x, y) in enumerate(ARENA_POSITIONS):
        for line in (folder / f"loc_{scan:02d}.dat").read_text().splitlines():
            distance, angle = map(float, line.strip("() \t").split(","))
            echo = np.inf if distance >= ARENA_NO_ECHO else distance / 100
            rows.append((x / 100, y / 100, angle, echo, ARENA_CONE, np.nan, scan))
    return _readings(rows, "arena")


def _readings(rows: list[Row], name: str) -> Readings:
    lines = [",".join("" if value != value else repr(float(value)) for value in row) for row in rows]
    return read_table("\n".join(("x,y,theta,range,cone,t,scan", *lines)).encode(), name)
