"""What is in a log, as `prf info` prints it, and signs that it is not what it seems.

Such signs are jumps, clocks that do not run, ranges that no scanner has. Whether the poses agree with one another over
loops is not checked, so nothing here means that a log is good.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from prf.model.ranges import unit_vectors
from prf.model.sensors import LARGEST_RANGE, SonarModel
from prf.model.window import Window
from prf.readings.readings import Kind, Readings, ScanTable
from prf.readings.steps import MEND_UNIT, OFF_MIDDLE, devices_of, jitter_of, jumps, listed
from prf.readings.text import FloatArray

MAX_RANGE_SHARE = 0.97
"""Default maximum range over largest range: the numbers that mean "no return" in a log spread by less (51.05-51.16)."""

FAR_BEYOND = 1.5
"""Maximum range over the largest return from which on beams without return count as free where none ever returned."""
FAR = 8.0  # metres. What indoor mapping usually cuts ranges at; the share beyond shows how much such a cut would cost


@dataclass(frozen=True)
class LogSummary:
    """What is in a log."""

    # source, format: name and format of the log
    source: str
    format: str
    kind: Kind  # what the readings are: sonar's if any has an opening angle
    devices: tuple[str, ...]  # the kinds of scan in it: kinds of line, devices or topics
    range_unit: str  # in which unit ranges were that are metres here, and how that is known; empty: in metres
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
    path_extent: Window
    path_length: float  # sum of the steps between successive scans of the first device, metres
    returns_extent: Window | None
    duration: float  # seconds from the smallest to the largest time stamp; nan if there are none
    # largest_range, max_range: largest finite range of the log, cut at the sensors' own maximum (nan if no range is
    # finite), and the maximum range that `prf sample` takes for it: from the log for a laser, 3.5 m for sonars
    largest_range: float
    max_range: float
    largest_return: float  # largest range below the maximum, metres; nan where there is none
    share_no_return: float  # share of beams at or beyond the maximum range
    share_far: float  # share of beams of at least `FAR` metres, no returns included; of sonars returns alone
    n_zero_ranges: int  # beams dropped because their range is 0
    n_invalid: int  # beams dropped because their range is not a number or below the sensor's own minimum
    # lines, odd_lines: lines (of a bag: messages, by topic) skipped: of kinds that the format knows, and of others
    lines: dict[str, int]
    odd_lines: dict[str, int]
    remarks: tuple[str, ...]  # what the reader had to assume
    suspicions: tuple[Suspicion, ...]  # what a person should look at before mapping
    # standard deviations of the poses of a laser, metres and radians, by which its scans disagree; None: not shown
    pose_error: tuple[float, float] | None = None
    # how to map it; and how to sample its poses too, empty where that is the same, or needless
    command: str = ""
    command_poses: str = ""

    @property
    def max_range_advice(self) -> float | None:
        """Metres that beams without return had better count as free to; None where the maximum range is near that."""
        too_far = self.kind == "laser" and self.max_range > FAR_BEYOND * self.largest_return
        return float(math.ceil(self.largest_return)) if too_far and self.share_no_return else None


def describe(readings: Readings, path: str) -> LogSummary:
    """Return what is in a whole log, `path` being its name in the summary."""
    notes = readings.notes
    scans = notes.scans
    is_sonar = bool(readings.cone.any())
    max_range = SonarModel().max_range if is_sonar else default_max_range(readings)
    return LogSummary(
        source=path,
        format=notes.format,
        kind="sonar" if is_sonar else "laser",
        devices=notes.devices,
        range_unit=notes.range_unit,
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
        largest_return=float(np.max(readings.range[readings.range < max_range], initial=0.0)) or float("nan"),
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


def _extent(xy: FloatArray) -> Window:
    (x_min, y_min), (x_max, y_max) = xy.min(axis=0), xy.max(axis=0)
    return Window(float(x_min), float(y_min), float(x_max), float(y_max))


def _returns_extent(readings: Readings, max_range: float) -> Window | None:
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


logger = logging.getLogger(__name__)

LEAST_TURN = 0.01  # radians: by how much poses that jitter are taken to err at least
MAX_RANGE = 1000.0
"""Metres. Some drivers write the largest float for "no return", which makes a default maximum range of no use."""
USUAL_RANGE, USUAL_ECHO = 100.0, 20.0
"""Metres. Half of the returns or echoes beyond them are a log in millimetres or centimetres."""
WRONG_UNITS = ("range-unit", "pose-unit")
"""Codes of suspicions with which nothing can be mapped."""
MAX_ANGLE = 4 * np.pi  # radians. Beyond it headings are counted over turns at best, in degrees at worst


class Suspicion(NamedTuple):
    """Something to look at: one word for scripts, one sentence, and all scans concerned (none: the whole log)."""

    code: str
    message: str
    scans: tuple[int, ...] = ()


def find_suspicions(readings: Readings) -> tuple[Suspicion, ...]:
    """Return what looks suspicious in a whole log."""
    of_poses = (Suspicion("poses", warning) for warning in readings.notes.warnings)
    return (
        *of_poses,
        *find_spoiling(readings),
        *_clock(readings.notes.scans),
        *_dropped(readings),
        *_odd_lines(readings),
    )


def find_spoiling(readings: Readings) -> tuple[Suspicion, ...]:
    """Return what of it would spoil a map: wrong units, and poses that jump or jitter."""
    jumping = (Suspicion(*each) for each in jumps(readings.notes.scans))
    return (*jumping, *_jitter(readings), *_ranges(readings), *_angles(readings))


def warn_of_spoiling(readings: Readings, used: Readings, kind: Kind, max_range: float | None) -> None:
    """Log a warning of each sign that a map of these readings would be spoilt.

    `readings`: the whole log. `used`: what is used of it: jumps before its first scan or after its last do no harm.
    `kind`: what the readings were given as. `max_range`: metres, if it need not be taken from the log.
    """
    first, last = (int(used.scan.min()), int(used.scan.max())) if used.n_beams else (0, 0)
    for code, message, scans in find_spoiling(readings):
        is_elsewhere = bool(scans) and not any(first < number <= last for number in scans)
        if not is_elsewhere and not (code == "largest-range" and max_range is not None):
            logger.warning(f"{readings.source}: {message}")
    if kind == "laser" and readings.cone.any():
        logger.warning(f"{readings.source}: has opening angles (cone) as of a sonar: should it be given as --sonar?")


def _jitter(readings: Readings) -> Iterator[Suspicion]:
    """Yield which poses of sonars jitter; scans of a laser show by themselves by how much theirs err."""
    if not readings.cone.any():
        return
    devices = list(devices_of(readings.notes.scans))
    if not devices:
        return
    found = max(map(jitter_of, devices), key=lambda each: each.metres)
    if found.is_jitter:
        text = (
            f"poses jitter: half of them lie {found.metres * OFF_MIDDLE:.2f} m or more off the middle of the poses "
            f"before and after, at steps of {found.usual_step:.2f} m. Sample them with the map, prf sample "
            f"--pose-noise {found.metres:.2g} {max(found.radians, LEAST_TURN):.2g}"
        )
        yield Suspicion("pose-jitter", text)


def _clock(scans: ScanTable) -> Iterator[Suspicion]:
    time = scans.time
    if np.isnan(time).all():
        return
    change = np.diff(time)
    back = tuple(int(n) for n in scans.number[1:][change < 0])
    tied = int(np.count_nonzero((change == 0) & (np.diff(scans.device) == 0)))
    if back:
        yield Suspicion("time-backward", f"the clock runs backward before {listed(back, 'scan')}", back)
    if tied:
        yield Suspicion("time-tied", f"{tied} of {len(change)} scans have the time stamp of the scan before")


def _ranges(readings: Readings) -> Iterator[Suspicion]:
    finite = readings.range[np.isfinite(readings.range)]
    if not len(finite):
        return
    usual = float(np.quantile(finite, 0.5, method="lower"))
    if usual > (USUAL_ECHO if readings.cone.any() else USUAL_RANGE):
        yield Suspicion("range-unit", f"half of the ranges are above {usual:g} m: are they in millimetres? {MEND_UNIT}")
    elif (largest := float(finite.max())) > MAX_RANGE:
        yield Suspicion("largest-range", f"the largest range is {largest:g} m: give the maximum range yourself")


def _angles(readings: Readings) -> Iterator[Suspicion]:
    turned = readings.angle[readings.angle != 0.0]
    largest = float(np.abs(turned).max(initial=0.0))
    are_whole = len(turned) > 0 and float(np.mean(turned == np.round(turned))) > 0.5
    if largest > MAX_ANGLE or (largest > 2 * np.pi and are_whole):
        yield Suspicion("angle", f"directions reach {largest:g} rad: are they in degrees? Save them in radians")


def _dropped(readings: Readings) -> Iterator[Suspicion]:
    zero, invalid = readings.notes.n_zero_ranges, readings.notes.n_invalid
    n_beams = zero + invalid + readings.n_beams
    if zero:
        yield Suspicion("zero-range", f"{zero} beams ({zero / n_beams:.2%}) have range 0, an error code: dropped")
    if invalid:
        text = f"{invalid} beams ({invalid / n_beams:.2%}) have a range that is not a number or too short: dropped"
        yield Suspicion("invalid-range", text)
    if np.isnan(readings.largest_range):
        yield Suspicion("no-return", "no beam has a finite range, so this log gives no maximum range")


def _odd_lines(readings: Readings) -> Iterator[Suspicion]:
    odd = readings.notes.odd_lines
    if odd:
        kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(odd.items(), key=lambda item: -item[1])[:5])
        yield Suspicion("odd-line", f"lines of unknown kinds were skipped: {kinds}")
