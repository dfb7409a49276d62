"""Readings as the text of logs: CARMEN lines for a laser, a table for a ring of sonars."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from prf.logs.describe import MAX_RANGE_SHARE
from prf.logs.rings import CONE, PIONEER
from prf.logs.table import OPTIONAL, REQUIRED
from prf.logs.track import mounted
from prf.simulate.laser import LaserPhysics
from prf.simulate.path import DIGITS, Scans
from prf.simulate.world import Floats

LEAST_RANGE = 0.001
"""Metres, the resolution of a log: a range of 0 is an error code."""
HOST = "simulated"


def no_return_number(max_range: float) -> float:
    """Return the range that a log has for "no return": the default maximum range that readers take is `max_range`."""
    centimetres = math.ceil(100.0 * max_range / MAX_RANGE_SHARE)
    rounds_off = MAX_RANGE_SHARE * (centimetres / 100.0) < max_range
    return (centimetres + rounds_off) / 100.0


def carmen_lines(scans: Scans, readings: Floats, physics: LaserPhysics) -> Iterator[str]:
    """Yield the lines of a CARMEN log: FLASER for half a circle, ROBOTLASER1, which has angles, for other scanners.

    Parameters
    ----------
    scans : Scans
        Poses of the laser.
    readings : (n_scans, n_beams) float64
        Metres, written in millimetres; inf: no return; 0: dropped.
    physics : LaserPhysics
    """
    silent = no_return_number(physics.max_range)
    kind = "FLASER" if physics.is_half_circle else "ROBOTLASER1"
    yield "# A simulated drive, made by prf simulate: poses are exact, and the laser's"
    yield f"# message formats defined: {kind}"
    yield f"# no return: {silent:g}; dropped: 0"
    for pose, time, row in zip(scans.pose, scans.time.tolist(), readings, strict=True):
        ranges = " ".join(_shown(np.where(np.isinf(row), silent, np.where(row > 0.0, np.maximum(row, LEAST_RANGE), 0))))
        at = " ".join(f"{value:.{DIGITS}f}" for value in pose.tolist())
        stamp = f"{time:.3f} {HOST} {time:.3f}"
        if physics.is_half_circle:
            yield f"FLASER {len(row)} {ranges} {at} {at} {stamp}"
            continue
        begin, step = float(physics.bearings[0]), physics.step
        scanner = f"0 {begin!r} {physics.field_of_view!r} {step!r} {silent:g} {physics.noise:g} 0"
        yield f"ROBOTLASER1 {scanner} {len(row)} {ranges} 0 {at} {at} 0 0 0 0 0 {stamp}"


def sonar_lines(scans: Scans, readings: Floats) -> Iterator[str]:
    """Yield the lines of a table of sonar readings, one row a transducer, an empty range for no return.

    Parameters
    ----------
    scans : Scans
        Poses of the robot.
    readings : (n_scans, 16) float64
        Metres; inf: no return.
    """
    yield ",".join((*REQUIRED, *OPTIONAL))
    for number, (pose, time, row) in enumerate(zip(scans.pose, scans.time.tolist(), readings, strict=True)):
        for (x, y, theta), text in zip(mounted(pose, PIONEER).tolist(), _shown(row), strict=True):
            distance = "" if text == "inf" else text
            yield f"{x:.{DIGITS}f},{y:.{DIGITS}f},{theta:.{DIGITS}f},{distance},{CONE:g},{time:.3f},{number}"


def path_lines(scans: Scans) -> Iterator[str]:
    """Yield the lines of a table of poses, which `prf simulate --path` takes again."""
    yield "x,y,theta,t"
    for pose, time in zip(scans.pose.tolist(), scans.time.tolist(), strict=True):
        yield ",".join(f"{value:.{DIGITS}f}" for value in pose) + f",{time:.3f}"


def _shown(values: Floats) -> list[str]:
    """Return numbers in millimetres, without zeros at the end."""
    return [f"{value:.3f}".rstrip("0").rstrip(".") for value in values.tolist()]
