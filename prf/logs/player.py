"""Text logs of the Player robot server, 1.x and 2.x (3.x alike): ``laser``, ``sonar`` and ``position`` lines.

Player's ``writelog`` driver documents the layout, metres and radians throughout. Common to all lines of 2.x, then what
follows by interface and (type, subtype)::

    time host robot interface index type subtype ...
    laser (1, 1)       scan_id min_angle max_angle resolution max_range n (range intensity)*n
    laser (1, 2)       scan_id robot_x robot_y robot_heading min_angle ... as above
    laser (4, 1)       x y heading length width                   where the laser sits on the robot
    sonar (1, 1)       n r1..rn
    sonar (1, 2), (4, 1)   n (x y heading)*n                      where the transducers sit
    position2d (1, 1)  x y heading vx vy turn_rate stall

Lines of 1.x have the time of the data in place of type and subtype, always with a decimal point, which tells the two::

    time host port interface index data_time ...
    laser              min_angle max_angle resolution n (range intensity)*n
    sonar              n (x y heading)*n n r1..rn
    position           x y heading vx vy turn_rate stall

So 1.x does not say where the laser sits (taken for the robot's centre) nor its maximum range. In 2.x a range at or
above the stated maximum is no return. The pose of the robot at a reading comes from the position lines
(:func:`prf.logs.track.poses_at`), except for (1, 2), which carries it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from prf.logs.numbers import MEND, check_pose, check_ranges, check_time, count_odd_kind, parse_count, parse_floats
from prf.logs.readings import FloatArray, Kind
from prf.shell.errors import InputError

POSITIONS = (b"position", b"position2d")
DATA, GEOMETRY = 1, 4
"""Types of the messages that hold readings and answers to questions about geometry."""

PRINTED = 0.0005
"""Metres. Ranges are printed to the millimetre, the maximum range to a tenth of it."""


class Header(NamedTuple):
    """What every line begins with; `kind` is (type, subtype), None in 1.x; `rest` are the fields that follow."""

    line: int
    where: str
    device: str
    time: float
    kind: tuple[int, int] | None
    rest: list[bytes]


class LaserScan(NamedTuple):
    """A laser line; `robot` is the pose in the line, if any, `max_range` nan where it has none."""

    device: str
    line: int
    time: float
    bearing: FloatArray
    ranges: FloatArray
    max_range: float
    robot: FloatArray | None


class SonarScan(NamedTuple):
    """A sonar line; `ring` is the geometry in the line, if any."""

    device: str
    line: int
    time: float
    ranges: FloatArray
    ring: FloatArray | None


@dataclass
class PlayerLog:
    """What stands in a log, by device, say ``laser:0``.

    Attributes
    ----------
    lasers, sonars : list
        Scans in the order of the file.
    tracks : dict
        (line, time, pose) rows by position device.
    mounts : dict
        Pose (3,) on the robot of each laser whose geometry is in the log.
    rings : dict
        Poses (n, 3) of the transducers, likewise.
    lines, odd_lines : Counter
        Lines by interface: those not looked at, and of interfaces that are no Player's.
    """

    lasers: list[LaserScan] = field(default_factory=list)
    sonars: list[SonarScan] = field(default_factory=list)
    tracks: dict[str, list[tuple[int, float, FloatArray]]] = field(default_factory=dict)
    mounts: dict[str, FloatArray] = field(default_factory=dict)
    rings: dict[str, FloatArray] = field(default_factory=dict)
    lines: Counter[str] = field(default_factory=Counter)
    odd_lines: Counter[str] = field(default_factory=Counter)


def parse_player(data: bytes, source: str, kinds: tuple[Kind, ...]) -> PlayerLog:
    """Parse the lines of a Player log.

    Parameters
    ----------
    data : bytes
        The text of the log, decompressed.
    source : str
        Name of the log, for messages.
    kinds : tuple of {"laser", "sonar"}
        Readings to parse; lines of others are only counted.

    Raises
    ------
    InputError
        For a damaged line, with its number.
    """
    log = PlayerLog()
    for number, line in enumerate(data.splitlines(), 1):
        fields = line.split()
        if not fields or fields[0].startswith(b"#"):
            log.lines["comment"] += bool(fields)
            continue
        _read_line(_header(fields, number, f"{source}:{number}"), fields[3], log, kinds)
    return log


def _header(fields: list[bytes], number: int, where: str) -> Header:
    if len(fields) < 6:
        from_line = f"line of {len(fields)} fields ends before its message"
        raise InputError(f"{where}: {from_line}. {MEND}")
    device = f"{fields[3].decode('ascii', 'replace')}:{fields[4].decode('ascii', 'replace').lstrip('0') or '0'}"
    if b"." in fields[5]:
        return Header(number, where, device, _time(fields[5], where), None, fields[6:])
    if len(fields) < 7:
        raise InputError(f"{where}: line ends before its subtype. {MEND}")
    kind = (parse_count(fields[5], where, "the type"), parse_count(fields[6], where, "the subtype"))
    return Header(number, where, device, _time(fields[0], where), kind, fields[7:])


def _time(text: bytes, where: str) -> float:
    return check_time(float(parse_floats([text], where)[0]), where)


def _read_line(header: Header, interface: bytes, log: PlayerLog, kinds: tuple[Kind, ...]) -> None:
    if interface == b"laser" and "laser" in kinds:
        _read_laser(header, log)
    elif interface == b"sonar" and "sonar" in kinds:
        _read_sonar(header, log)
    elif interface in POSITIONS:
        _read_position(header, log)
    elif interface.isalnum() and interface[:1].isalpha():
        log.lines[interface.decode("ascii", "replace")] += 1
    else:
        count_odd_kind(log.odd_lines, interface)


def _read_laser(header: Header, log: PlayerLog) -> None:
    if header.kind is None:
        log.lasers.append(_laser_scan(header, 0, None, has_max=False))
    elif header.kind == (DATA, 1):
        log.lasers.append(_laser_scan(header, 1, None, has_max=True))
    elif header.kind == (DATA, 2):
        _need(header, 4, "its pose")
        robot = parse_floats(header.rest[1:4], header.where)
        check_pose(robot, header.where)
        log.lasers.append(_laser_scan(header, 4, robot, has_max=True))
    elif header.kind == (GEOMETRY, 1):
        _need(header, 5, "the laser's size")
        log.mounts[header.device] = _checked_pose(header)
    else:
        log.lines["laser"] += 1


def _laser_scan(header: Header, start: int, robot: FloatArray | None, has_max: bool) -> LaserScan:
    """Parse from min_angle on, which is field `start` of the message."""
    end = start + (5 if has_max else 4)
    _need(header, end, "its number of readings")
    where = header.where
    n = parse_count(header.rest[end - 1], where, "the number of readings")
    pairs = header.rest[end:]
    if n == 0 or len(pairs) != 2 * n:
        has = f"announces {n} pairs of range and intensity, but has {len(pairs)} fields of them"
        raise InputError(f"{where}: laser line {has}. {MEND}")
    # As floats of Python, which overflow without a word.
    low, high, step = parse_floats(header.rest[start : start + 3], where).tolist()
    bearing = _bearings(low, high, step, _rounding(header.rest[start + 2]), n, where)
    ranges = parse_floats(pairs[::2], where)
    check_ranges(ranges, where)
    top = float(parse_floats([header.rest[end - 2]], where)[0]) if has_max else np.nan
    return LaserScan(header.device, header.line, header.time, bearing, ranges, top, robot)


def _rounding(text: bytes) -> float:
    """Return by how much a number may be off that was rounded to the digits of its text."""
    _, point, digits = text.partition(b".")
    return float(0.5 * 10.0 ** -len(digits)) if point and digits.isdigit() else 0.0


def _bearings(low: float, high: float, step: float, rounding: float, n: int, where: str) -> FloatArray:
    """Return n angles from `low` on: up to `high` if the step leads there, else up to one step before it, or as it is.

    Logs before Player 1.6 have four digits of the step, 0.0087 for half a degree: 360 of these are half a degree short.
    """
    within_circle = 0 < abs(step) * max(n - 1, 1) <= 2 * np.pi + abs(step) < np.inf
    if not (within_circle and max(abs(low), abs(high)) <= 2 * np.pi):
        raise InputError(f"{where}: {n} beams from {low:g} to {high:g} in steps of {step:g} rad are no scan. {MEND}")
    span = high - low
    if n > 1 and (abs((n - 1) * step - span) < abs(step) / 2 or abs(span / (n - 1) - step) <= rounding):
        return np.linspace(low, high, n, dtype=np.float64)
    exact = span / n if abs(span / n - step) <= rounding else step
    return low + exact * np.arange(n, dtype=np.float64)


def _read_sonar(header: Header, log: PlayerLog) -> None:
    if header.kind is None:
        ring, rest = _ring(header, header.rest)
        log.sonars.append(_sonar_scan(header, rest, ring if len(ring) else None))
    elif header.kind == (DATA, 1):
        log.sonars.append(_sonar_scan(header, header.rest, None))
    elif header.kind in ((DATA, 2), (GEOMETRY, 1)):
        ring, rest = _ring(header, header.rest)
        _no_more(header, rest)
        log.rings[header.device] = ring
    else:
        log.lines["sonar"] += 1


def _sonar_scan(header: Header, fields: list[bytes], ring: FloatArray | None) -> SonarScan:
    n = parse_count(fields[0] if fields else b"", header.where, "the number of readings")
    if n == 0 or len(fields) != n + 1:
        raise InputError(f"{header.where}: sonar line announces {n} readings, but has {len(fields) - 1}. {MEND}")
    if ring is not None and len(ring) != n:
        raise InputError(f"{header.where}: sonar line of {n} readings and {len(ring)} transducers. {MEND}")
    ranges = parse_floats(fields[1:], header.where)
    check_ranges(ranges, header.where)
    return SonarScan(header.device, header.line, header.time, ranges, ring)


def _ring(header: Header, fields: list[bytes]) -> tuple[FloatArray, list[bytes]]:
    """Parse ``n (x y heading)*n`` and return what follows too."""
    n = parse_count(fields[0] if fields else b"", header.where, "the number of transducers")
    if len(fields) < 3 * n + 1:
        has = f"{n} transducers, but has {len(fields) - 1} numbers for them"
        raise InputError(f"{header.where}: sonar line announces {has}. {MEND}")
    ring = parse_floats(fields[1 : 3 * n + 1], header.where).reshape(n, 3)
    if n:
        check_pose(ring.reshape(-1), header.where)
    return ring, fields[3 * n + 1 :]


def _read_position(header: Header, log: PlayerLog) -> None:
    if header.kind not in (None, (DATA, 1)):
        log.lines[header.device.partition(":")[0]] += 1
        return
    _need(header, 7, "its stall flag")
    log.tracks.setdefault(header.device, []).append((header.line, header.time, _checked_pose(header)))


def _checked_pose(header: Header) -> FloatArray:
    pose = parse_floats(header.rest[:3], header.where)
    check_pose(pose, header.where)
    return pose


def _need(header: Header, n: int, what: str) -> None:
    if len(header.rest) < n:
        raise InputError(f"{header.where}: {header.device} line ends before {what}. {MEND}")


def _no_more(header: Header, fields: list[bytes]) -> None:
    if fields:
        raise InputError(f"{header.where}: {len(fields)} fields too many after the transducers. {MEND}")
