"""CARMEN logs: ``FLASER``, ``RLASER`` and ``ROBOTLASER0`` to ``ROBOTLASER5`` lines.

One message stands on a line, and the first field alone says which (comments may hold any of these words)::

    FLASER n r1..rn laser_x laser_y laser_theta robot_x robot_y robot_theta time host logger_time
    RLASER ...                                                                     likewise
    ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n r1..rn m s1..sm
        laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward side [turn_axis] time host logger_time

The laser pose is the pose of the scanner itself, so no ``PARAM robot_frontlaser_offset`` is added again. For the rear
laser CARMEN's robot module writes laser_theta = robot_theta + pi (``construct_laser_message`` in robot_laser.c): the
heading in the line already looks backwards, and the beams are laid out round it exactly as for the front laser.

``FLASER`` and ``RLASER`` carry no angles. Beam 0 looks to the right (-pi/2), angles run counter-clockwise; the step is
pi/n for n = 180 or 360 (the last beam of the half circle is left out) and pi/(n - 1) for n = 181 or 361. For n = 401,
and 400 without the last beam, it is a quarter of a degree over 100 degrees, a mode of SICK's scanners, which look as
far to the left as to the right. For any other n CARMEN assumes pi/(n - 1) (``carmen_laser_guess_angle_increment`` in
readlog.c). So does this reader, with a remark for all but the first four.

A range of exactly 0 is a scanner's error code (too near, blinded): dropped and counted. In ``ROBOTLASER`` lines a range
at or above the stated maximum is no return. In the others numbers that mean it (81.91, 51.1, 50 ...) stay as they are,
since they cannot be told from ranges without the user's maximum.

``SONAR`` lines have a reader of their own, :mod:`prf.logs.carmen_sonar`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.logs.numbers import MEND, check_pose, check_ranges, check_time, count_odd_kind, parse_count, parse_floats
from prf.logs.readings import FloatArray, LogNotes, NoReadings, Readings
from prf.logs.scans import Scan, assemble
from prf.shell.errors import ConfigError, InputError

ROBOT_LASERS = tuple(f"ROBOTLASER{i}" for i in range(6))

RAW_LASERS = tuple(f"RAWLASER{i}" for i in range(6))

LASERS = ("FLASER", "RLASER", "LASER3", "LASER4", "LASER5", "REMISSIONFLASER", "REMISSIONRLASER", "POSITIONLASER")
BASE = (
    "PARAM",
    "SYNC",
    "ODOM",
    "TRUEPOS",
    "GLOBALPOS",
    "NEFF",
    "MARKER",
    "SONAR",
    "BUMPER",
    "ARM",
    "IMU",
    "SCANMARK",
    "NMEAGGA",
)
COMMANDS = ("NMEARMC", "VECTORMOVE", "ROBOTVELOCITY", "FOLLOWTRAJECTORY", "BASEVELOCITY")
QUARTER_DEGREES = (400, 401)
"""Beams of a scan over 100 degrees in steps of a quarter of a degree."""

KNOWN_KINDS = frozenset((*LASERS, *RAW_LASERS, *ROBOT_LASERS, *BASE, *COMMANDS))
"""First fields of CARMEN's log format; NEFF is an addition of GMapping's."""


class LaserLine(NamedTuple):
    """One laser line; `bearing` is relative to the heading of `pose`, the laser's; `robot` is the pose of the base.

    `max_range` is the scanner's, metres; nan where the line has none.
    """

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
        return np.asarray(self.ranges < (self.max_range if self.max_range > 0.0 else np.inf))


@dataclass
class _Log:
    """What has been gathered from the lines so far."""

    scans: list[LaserLine] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)
    odd: Counter[str] = field(default_factory=Counter)


def read_carmen(data: bytes, source: str, device: str | None = None) -> Readings:
    """Read the localized laser scans of a CARMEN log.

    Parameters
    ----------
    data : bytes
        The text of the log, decompressed.
    source : str
        Name of the log, for messages.
    device : str, optional
        Only the lines of this kind, say FLASER; default all lasers.

    Returns
    -------
    Readings
        Every beam whose range is not 0. Scans are numbered from 0 in the order of the file, all lasers together.

    Raises
    ------
    InputError
        For a laser line that is damaged (wrong count, not a number, negative range, pose that is not finite), and for
        a log without such lines (then :class:`NoReadings`).
    ConfigError
        If the log has laser lines, but none of `device`.
    """
    log = _Log()
    for number, line in enumerate(data.splitlines(), 1):
        fields = line.split()
        if fields:
            _read_line(fields, number, source, log)
    if not log.scans:
        raise NoReadings(_nothing(source, log))
    return _assemble(_only(log.scans, device, source), log, source)


def _read_line(fields: list[bytes], number: int, source: str, log: _Log) -> None:
    if fields[0].startswith(b"#"):
        log.kinds["comment"] += 1
        return
    kind = fields[0].decode("latin-1")
    parse = LASER_PARSERS.get(kind)
    if parse is not None:
        log.scans.append(parse(kind, fields, number, f"{source}:{number}"))
    elif kind in KNOWN_KINDS:
        log.kinds[kind] += 1
    else:
        count_odd_kind(log.odd, fields[0])


def _parse_plain_laser(kind: str, fields: list[bytes], number: int, where: str) -> LaserLine:
    n = _beam_count(kind, fields, 1, where)
    _check_length(kind, fields, (n + 11,), f"{n} readings", where)
    values = parse_floats(fields[2 : n + 9], where)
    return _laser_line(kind, number, where, values[:n], plain_bearings(n), values[n : n + 6], float(values[n + 6]))


def _parse_robot_laser(kind: str, fields: list[bytes], number: int, where: str) -> LaserLine:
    n = _beam_count(kind, fields, 8, where)
    if len(fields) <= n + 9:
        _check_length(kind, fields, (n + 23,), f"{n} readings", where)
    m = parse_count(fields[n + 9], where, "the number of remission values")
    # The format page of CARMEN has turn_axis, some writers of the format leave it out.
    _check_length(kind, fields, (n + m + 24, n + m + 23), f"{n} readings and {m} remission values", where)
    start, _, step, max_range = parse_floats(fields[2:6], where)
    within_circle = 0 < abs(step) * max(n - 1, 1) <= 2 * np.pi + 1e-6
    if not (within_circle and abs(start) <= 2 * np.pi):
        raise InputError(f"{where}: {n} beams from {start:g} in steps of {step:g} rad are no scan. {MEND}")
    ranges = parse_floats(fields[9 : n + 9], where)
    poses = parse_floats(fields[n + m + 10 : n + m + 16], where)
    time = parse_floats(fields[-3:-2], where)
    line = _laser_line(kind, number, where, ranges, start + step * np.arange(n), poses, float(time[0]))
    return line._replace(max_range=float(max_range))


LASER_PARSERS: dict[str, Callable[[str, list[bytes], int, str], LaserLine]] = {
    "FLASER": _parse_plain_laser,
    "RLASER": _parse_plain_laser,
    **dict.fromkeys(ROBOT_LASERS, _parse_robot_laser),
}
"""By the first field of a line: parser of its (kind, fields, line number, file:line)."""


def _beam_count(kind: str, fields: list[bytes], place: int, where: str) -> int:
    if len(fields) <= place:
        raise InputError(f"{where}: {kind} line ends before its number of readings. {MEND}")
    n = parse_count(fields[place], where, "the number of readings")
    if n == 0:
        raise InputError(f"{where}: {kind} line without readings. {MEND}")
    return n


def _check_length(kind: str, fields: list[bytes], allowed: tuple[int, ...], announced: str, where: str) -> None:
    if len(fields) not in allowed:
        has = f"announces {announced}, which makes {allowed[0]} fields, but has {len(fields)}"
        raise InputError(f"{where}: {kind} line {has}. {MEND}")


def _laser_line(
    kind: str, number: int, where: str, ranges: FloatArray, bearing: FloatArray, poses: FloatArray, time: float
) -> LaserLine:
    check_ranges(ranges, where)
    check_pose(poses[:3], where)
    check_time(time, where)
    return LaserLine(kind, number, ranges, bearing, poses[:3], time, poses[3:])


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


def _only(scans: list[LaserLine], device: str | None, source: str) -> list[LaserLine]:
    kinds = tuple(dict.fromkeys(scan.kind for scan in scans))
    if device is not None and device not in kinds:
        raise ConfigError(f"--topic {device}: {source} has {', '.join(kinds)}.")
    return scans if device is None else [scan for scan in scans if scan.kind == device]


def _assemble(lines: list[LaserLine], log: _Log, source: str) -> Readings:
    reached = [scan.max_range for scan in lines if scan.max_range > 0.0 and not scan.is_return.all()]
    notes = LogNotes(
        format="CARMEN",
        sensor_max=max(reached, default=np.nan),
        lines=dict(log.kinds),
        odd_lines=dict(log.odd),
        remarks=_remarks(lines),
    )
    return assemble([_scan(line) for line in lines], source, notes)


def _scan(line: LaserLine) -> Scan:
    ranges = np.where(line.is_return, line.ranges, np.inf)
    return Scan(line.kind, line.line, line.time, line.pose, line.pose[:2], line.pose[2] + line.bearing, ranges)


def _remarks(scans: list[LaserLine]) -> tuple[str, ...]:
    remarks = []
    counts = {len(scan.ranges) for scan in scans if scan.kind in ("FLASER", "RLASER")}
    narrow = sorted(counts & set(QUARTER_DEGREES))
    if narrow:
        beams = " and ".join(map(str, narrow))
        remarks.append(f"laser lines of {beams} beams carry no angles: 100 degrees in steps of 0.25 are assumed")
    guessed = sorted(counts - {180, 181, 360, 361, *QUARTER_DEGREES})
    if guessed:
        beams = ", ".join(map(str, guessed[:5]))
        remarks.append(f"laser lines of {beams} beams carry no angles: half a circle is assumed, both ends included")
    turned = [np.cos(scan.pose[2] - scan.robot[2]) for scan in scans if scan.kind == "RLASER"]
    if turned and min(turned) > 0:
        remarks.append("the rear laser's heading is the robot's, where CARMEN writes it turned by pi; taken as it is")
    return tuple(remarks)


def _nothing(source: str, log: _Log) -> str:
    counts = (log.kinds + log.odd).most_common(6)
    found = ", ".join(f"{n} {kind}" for kind, n in counts) or "nothing"
    why = "no FLASER, RLASER or ROBOTLASER line, the ones that carry a laser pose"
    return f"{source}: CARMEN log with {why}; it has {found}. Use a log with corrected (localized) scans."
