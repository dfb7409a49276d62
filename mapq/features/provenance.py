"""Where and when the points of a map were seen, as far as its fields say so."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud

SCAN, TIME, PASS = "scan", "time", "pass_id"
TO_SENSOR = ("to_sensor_x", "to_sensor_y", "to_sensor_z")
"""Point fields that are read: number of the scan, seconds, number of the pass, and the way to the sensor in metres."""

MOMENT = 10.0
"""Seconds of a moment, where times are known but scans are not."""
MOST_MOMENTS = 1_000_000
"""Times that span more are none: a field of that name may hold anything."""


class Moments(NamedTuple):
    """Which points were seen together.

    Attributes
    ----------
    moment : (k,) int64
        Numbered from 0.
    reach : int
        Moments so far apart still count as one: neighbours, where time was cut into steps.
    """

    moment: NDArray[np.int64]
    reach: int


class Views(NamedTuple):
    """From where points were seen.

    Attributes
    ----------
    to_sensor : (k, 3) float64
        Metres, nan where it is not known.
    seen_by : (k,) int64
        Number of the pass, or else of the scan; all 0 where neither is known.
    passes_known : bool
    """

    to_sensor: NDArray[np.float64]
    seen_by: NDArray[np.int64]
    passes_known: bool


def moments_of(cloud: PointCloud, number: NDArray[np.int64]) -> Moments | None:
    """Return the moments of some points (k,) of a cloud: of its scans, else of its times, else of its passes."""
    scan = _whole(cloud, SCAN, number, least=1)
    if scan is not None:
        return Moments(scan, 0)
    time = _numbers(cloud, TIME, number)
    # Below a moment in all, the field is no clock of the drive, such as the time within one turn of the laser.
    if time is not None and np.isfinite(time).all() and MOMENT < np.ptp(time) < MOST_MOMENTS * MOMENT:
        return Moments(((time - time.min()) / MOMENT).astype(np.int64), 1)
    seen_by = _whole(cloud, PASS, number)
    return None if seen_by is None else Moments(seen_by, 0)


def views_of(cloud: PointCloud, number: NDArray[np.int64]) -> Views | None:
    """Return from where some points (k,) of a cloud were seen; None if it does not say."""
    columns = [_numbers(cloud, name, number) for name in TO_SENSOR]
    known = [column for column in columns if column is not None]
    if len(known) < len(columns):
        return None
    seen_by = _whole(cloud, PASS, number)
    if seen_by is None:
        seen_by = _whole(cloud, SCAN, number)
    if seen_by is None:
        return Views(np.column_stack(known), np.zeros(len(number), np.int64), False)
    return Views(np.column_stack(known), seen_by, True)


def _numbers(cloud: PointCloud, name: str, number: NDArray[np.int64]) -> NDArray[np.float64] | None:
    values = cloud.fields.get(name)
    if values is None or len(number) == 0 or values.ndim != 1 or values.dtype.kind not in "fiub":
        return None
    return np.asarray(values[number], np.float64)


def _whole(cloud: PointCloud, name: str, number: NDArray[np.int64], least: int = 2) -> NDArray[np.int64] | None:
    """Return a field of numbers of scans or passes, renumbered from 0 in ascending order; None if it is none.

    It must have `least` different values: one scan sees all that it sees at once, but a pass may come by twice.
    """
    values = _numbers(cloud, name, number)
    if values is None or not np.isfinite(values).all() or (values != np.floor(values)).any():
        return None
    distinct, renumbered = np.unique(values, return_inverse=True)
    return renumbered.astype(np.int64) if len(distinct) >= least else None
