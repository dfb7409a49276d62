"""What is in a log: counts, extent, ranges, and what looks suspicious, as `prf info` prints it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from prf.model.laser import unit_vectors
from prf.model.sonar import SonarModel
from prf.model.window import LARGEST_RANGE
from prf.readings.readings import Kind, Readings, ScanTable
from prf.readings.suspicions import Suspicion, find_suspicions
from prf.readings.text import FloatArray

MAX_RANGE_SHARE = 0.97
"""Default maximum range over largest range: the numbers that mean "no return" in a log spread by less (51.05-51.16)."""

FAR = 8.0  # metres. What indoor mapping usually cuts ranges at; the share beyond shows how much such a cut would cost


class Extent(NamedTuple):
    """A box round positions, metres."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float


@dataclass(frozen=True)
class LogSummary:
    """What is in a log."""

    # source, format: name and format of the log
    source: str
    format: str
    kind: Kind  # what the readings are: sonar's if any has an opening angle
    devices: tuple[str, ...]  # the kinds of scan in it: kinds of line, devices or topics
    poses: str  # where the poses are from
    # where the transducers of a sonar ring sit on the robot, metres and radians; empty if unknown
    ring: tuple[tuple[float, float, float], ...]
    cones: tuple[float, float]  # smallest and largest opening angle, radians
    # n_scans, n_beams: scans, and beams with a usable range
    n_scans: int
    n_beams: int
    beams_per_scan: tuple[int, int]  # fewest and most beams that a scan has in the file
    # path_extent, returns_extent: round the sensor positions, and round the end points of the beams below the maximum
    # range (None: no such beam)
    path_extent: Extent
    path_length: float  # sum of the steps between successive scans of the first device, metres
    returns_extent: Extent | None
    duration: float  # seconds from the smallest to the largest time stamp; nan if there are none
    # largest_range, max_range: largest finite range of the log, cut at the sensors' own maximum (nan if no range is
    # finite), and the maximum range that `prf sample` takes for it: from the log for a laser, 3.5 m for sonars
    largest_range: float
    max_range: float
    share_no_return: float  # share of beams at or beyond the maximum range
    share_far: float  # share of beams of at least `FAR` metres, no returns included; of sonars returns alone
    n_zero_ranges: int  # beams dropped because their range is 0
    n_invalid: int  # beams dropped because their range is no number or below the sensor's own minimum
    # lines, odd_lines: lines (of a bag: messages, by topic) skipped: of kinds that the format knows, and of others
    lines: dict[str, int]
    odd_lines: dict[str, int]
    remarks: tuple[str, ...]  # what the reader had to assume
    suspicions: tuple[Suspicion, ...]  # what a person should look at before mapping


def describe(readings: Readings, path: str) -> LogSummary:
    """Return what is in a whole log, `path` being its name in the summary."""
    notes = readings.notes
    scans = notes.scans
    is_sonar = bool(readings.cone.any())
    max_range = SonarModel.max_range if is_sonar else default_max_range(readings)
    return LogSummary(
        source=path,
        format=notes.format,
        kind="sonar" if is_sonar else "laser",
        devices=notes.devices,
        poses=notes.poses,
        ring=notes.ring,
        cones=(float(readings.cone.min()), float(readings.cone.max())),
        n_scans=len(scans.number),
        n_beams=readings.n_beams,
        beams_per_scan=(int(scans.n_beams.min()), int(scans.n_beams.max())),
        path_extent=_extent(scans.pose[:, :2]),
        path_length=_path_length(scans),
        returns_extent=_returns_extent(readings, max_range),
        duration=_duration(scans.time),
        largest_range=largest_range(readings),
        max_range=max_range,
        share_no_return=float(np.mean(~(readings.range < max_range))),
        share_far=float(np.mean((readings.range >= FAR) & ((readings.range < max_range) | (not is_sonar)))),
        n_zero_ranges=notes.n_zero_ranges,
        n_invalid=notes.n_invalid,
        lines=dict(notes.lines),
        odd_lines=dict(notes.odd_lines),
        remarks=notes.remarks,
        suspicions=find_suspicions(readings),
    )


def default_max_range(readings: Readings) -> float:
    """Return the maximum range taken of a laser if the user gives none: 0.97 x the largest; nan if none is finite."""
    return MAX_RANGE_SHARE * largest_range(readings)


def largest_range(readings: Readings) -> float:
    """Return the largest finite range that the log holds, cut at the sensors' own maximum; nan if none is finite."""
    top = readings.notes.sensor_max
    return float(np.fmax(readings.largest_range, top if top <= LARGEST_RANGE else np.nan))


def _extent(xy: FloatArray) -> Extent:
    (x_min, y_min), (x_max, y_max) = xy.min(axis=0), xy.max(axis=0)
    return Extent(float(x_min), float(y_min), float(x_max), float(y_max))


def _returns_extent(readings: Readings, max_range: float) -> Extent | None:
    hit = readings.range < max_range
    if not hit.any():
        return None
    direction = unit_vectors(readings.angle[hit])
    return _extent(readings.origin[hit] + readings.range[hit, None] * direction)


def _path_length(scans: ScanTable) -> float:
    steps = np.diff(scans.pose[scans.device == 0, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def _duration(time: FloatArray) -> float:
    known = time[np.isfinite(time)]
    return float(known.max() - known.min()) if len(known) else float("nan")
