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

Lines of 1.x have the time of the data, always with a decimal point, in place of type and subtype::

    time host port interface index data_time ...
    laser              min_angle max_angle resolution n (range intensity)*n
    sonar              n (x y heading)*n n r1..rn
    position           x y heading vx vy turn_rate stall

So 1.x does not say where the laser sits (taken for the robot's centre) nor its maximum range. In 2.x a range at or
above the stated maximum is no return. The pose of the robot at a reading is that of the position lines
(:class:`prf.logs.poses.Track`), except for (1, 2), which carries it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from prf.logs.poses import Track, mounted, ring_of
from prf.logs.readings import FloatArray, Kind, LogNotes, NoReadings, Readings, Scan, assemble
from prf.logs.text import MEND, check_pose, check_ranges, check_time, count_odd_kind, parse_count, parse_floats
from prf.shell.errors import ConfigError, InputError

POSITIONS = (b"position", b"position2d")
DATA, GEOMETRY = 1, 4
"""Types of the messages that hold readings and answers to questions about geometry."""
PRINTED = 0.0005
"""Metres. Ranges are printed to the millimetre, the maximum range to a tenth of it."""
NO_MOUNT = np.zeros(3)


class Header(NamedTuple):
    """What every line begins with; `kind` is (type, subtype), None in 1.x; `rest` are the fields that follow."""

    line: int
    where: str
    device: str
    time: float
    kind: tuple[int, int] | None
    rest: list[bytes]

    def need(self, n: int, what: str) -> None:
        """Refuse a line that ends before its n-th field."""
        if len(self.rest) < n:
            raise InputError(f"{self.where}: {self.device} line ends before {what}. {MEND}")

    def pose(self, start: int = 0) -> FloatArray:
        """Return the pose that begins at a field."""
        pose = parse_floats(self.rest[start : start + 3], self.where)
        check_pose(pose, self.where)
        return pose


class Shot(NamedTuple):
    """A line of readings.

    `bearing` (n,) is a laser's; `ring` (n, 3) a sonar's geometry, if in the line; `max_range` nan where the line has
    none; `robot` the pose in the line, if any.
    """

    device: str
    line: int
    time: float
    ranges: FloatArray
    bearing: FloatArray | None = None
    ring: FloatArray | None = None
    max_range: float = np.nan
    robot: FloatArray | None = None

    @property
    def returns(self) -> FloatArray:
        """Ranges, inf at or above the stated maximum."""
        top = self.max_range if self.max_range > 0 else np.inf
        return np.where(self.ranges < top - PRINTED, self.ranges, np.inf)


@dataclass
class PlayerLog:
    """What is in a log, by device, say ``laser:0``.

    Attributes
    ----------
    lasers, sonars : list of Shot
        In the order of the file.
    tracks : dict
        (line, time, pose) rows by position device.
    mounts, rings : dict
        Pose (3,) on the robot of each laser, poses (n, 3) of the transducers, where the geometry is in the log.
    lines, odd_lines : Counter
        Lines by interface: those not looked at, and of interfaces that are no Player's.
    """

    lasers: list[Shot] = field(default_factory=list)
    sonars: list[Shot] = field(default_factory=list)
    tracks: dict[str, list[tuple[int, float, FloatArray]]] = field(default_factory=dict)
    mounts: dict[str, FloatArray] = field(default_factory=dict)
    rings: dict[str, FloatArray] = field(default_factory=dict)
    lines: Counter[str] = field(default_factory=Counter)
    odd_lines: Counter[str] = field(default_factory=Counter)

    @property
    def counts(self) -> dict[str, int]:
        """How many lines there are of what was not read as readings."""
        counts = dict(self.lines) | {name: len(rows) for name, rows in self.tracks.items()}
        return {name: n for name, n in counts.items() if n}


def read_player(
    data: bytes, source: str, kind: Kind | None, cone: float, device: str | None = None, frame: str | None = None
) -> Readings:
    """Read the readings of a Player log, decompressed; parameters as of :func:`prf.logs.read_readings`.

    `device` is one such as ``laser:1`` (default all of the kind), `frame` the position device that gives the robot's
    pose, say ``position2d:1`` (default the first in the file).
    """
    log = parse_player(data, source, ("laser", "sonar") if kind is None else (kind,))
    is_laser = bool(log.lasers) and kind != "sonar"
    shots = log.lasers if is_laser else log.sonars
    if not shots:
        found = ", ".join(f"{n} {name}" for name, n in log.counts.items()) or "no other lines"
        raise NoReadings(f"{source}: Player log without {kind or 'laser or sonar'} readings; it has {found}.")
    if is_laser and kind is None:
        log.lines["sonar"] += len(log.sonars)
    if device is not None and device not in (present := tuple(dict.fromkeys(shot.device for shot in shots))):
        raise ConfigError(f"--topic {device}: {source} has {', '.join(present)}.")
    shots = shots if device is None else [shot for shot in shots if shot.device == device]
    return _lasers(log, shots, source, frame) if is_laser else _sonars(log, shots, source, cone, frame)


def _lasers(log: PlayerLog, shots: list[Shot], source: str, frame: str | None) -> Readings:
    poses, where_from, remarks = _poses(log, shots, source, frame)
    bare = sorted({shot.device for shot in shots} - set(log.mounts))
    if bare:
        remarks.append(f"the log does not say where {', '.join(bare)} sits: the robot's centre is assumed")
    reached = [shot.max_range for shot in shots if shot.max_range > 0 and np.isinf(shot.returns).any()]
    scans = []
    for shot, robot in zip(shots, poses, strict=True):
        if robot is not None and shot.bearing is not None:
            at = mounted(robot, log.mounts.get(shot.device, NO_MOUNT))
            scans.append(Scan(shot.device, shot.line, shot.time, at, at[:2], at[2] + shot.bearing, shot.returns))
    return assemble(scans, source, _notes(log, where_from, remarks, sensor_max=max(reached, default=np.nan)))


def _sonars(log: PlayerLog, shots: list[Shot], source: str, cone: float, frame: str | None) -> Readings:
    rings, remarks = _rings(log, shots, source)
    poses, where_from, more = _poses(log, shots, source, frame)
    scans = []
    for shot, robot, ring in zip(shots, poses, rings, strict=True):
        if robot is not None:
            at = mounted(robot, ring)
            scans.append(Scan(shot.device, shot.line, shot.time, robot, at[:, :2], at[:, 2], shot.ranges, cone))
    return assemble(scans, source, _notes(log, where_from, remarks + more, ring=rings[0]))


def _rings(log: PlayerLog, shots: list[Shot], source: str) -> tuple[list[FloatArray], list[str]]:
    """Return the ring of every scan, and remarks."""
    rings, remarks = [], {}
    for shot in shots:
        n = len(shot.ranges)
        ring = shot.ring if shot.ring is not None else log.rings.get(shot.device)
        if ring is None:
            ring = ring_of(n)
            remarks[shot.device] = f"no geometry of {shot.device} in the log: a Pioneer's ring of {n} is assumed"
        if ring is None or len(ring) != n:
            why = f"nothing says where the {n} transducers of {shot.device} sit"
            raise InputError(f"{source}:{shot.line}: {why}. Add a geometry line (sonar 004 001) before it.")
        rings.append(ring)
    return rings, list(remarks.values())


def _poses(
    log: PlayerLog, shots: list[Shot], source: str, frame: str | None
) -> tuple[list[FloatArray | None], str, list[str]]:
    """Return the robot's pose by shot, None where it is unknown; where the poses are from; remarks."""
    if frame is None and all(shot.robot is not None for shot in shots):
        return [shot.robot for shot in shots], "in the laser lines", []
    name = frame if frame is not None else next(iter(log.tracks), None)
    if name is None:
        raise InputError(f"{source}: no position line says where the robot was. Use a log with position2d lines.")
    if name not in log.tracks:
        raise ConfigError(f"--frame {name}: {source} has poses of {', '.join(log.tracks) or 'no device'}.")
    track = Track.from_rows(log.tracks[name])
    pose, known = track.poses_at(np.array([shot.line for shot in shots]), np.array([shot.time for shot in shots]))
    remarks = [f"the poses of {name} are corrected ones: as odometry alone they would drift"]
    if len(log.tracks) > 1:
        others = ", ".join(other for other in log.tracks if other != name)
        remarks.append(f"the robot is where {name} says; --frame can choose {others}")
    if not known.any():
        raise InputError(f"{source}: no reading lies within the time of the poses ({name}).")
    if not known.all():
        remarks.append(f"{np.count_nonzero(~known)} of {len(known)} scans lie outside the time of the poses: dropped")
    found = [at if is_known else None for at, is_known in zip(pose, known, strict=True)]
    return found, f"{name}, {track.how}", remarks


def _notes(
    log: PlayerLog, poses: str, remarks: list[str], sensor_max: float = np.nan, ring: FloatArray | None = None
) -> LogNotes:
    return LogNotes(
        format="Player",
        sensor_max=sensor_max,
        poses=poses,
        ring=() if ring is None else tuple(map(tuple, ring.tolist())),
        lines=log.counts,
        odd_lines=dict(log.odd_lines),
        remarks=tuple(remarks),
    )


def parse_player(data: bytes, source: str, kinds: tuple[Kind, ...]) -> PlayerLog:
    """Parse the lines of a Player log; readings of other than these kinds are only counted."""
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
        raise InputError(f"{where}: line of {len(fields)} fields ends before its message. {MEND}")
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
        log.lasers.append(_laser_shot(header, 0, None, has_max=False))
    elif header.kind == (DATA, 1):
        log.lasers.append(_laser_shot(header, 1, None, has_max=True))
    elif header.kind == (DATA, 2):
        header.need(4, "its pose")
        log.lasers.append(_laser_shot(header, 4, header.pose(1), has_max=True))
    elif header.kind == (GEOMETRY, 1):
        header.need(5, "the laser's size")
        log.mounts[header.device] = header.pose()
    else:
        log.lines["laser"] += 1


def _laser_shot(header: Header, start: int, robot: FloatArray | None, has_max: bool) -> Shot:
    """Parse from min_angle on, which is field `start` of the message."""
    end, where = start + (5 if has_max else 4), header.where
    header.need(end, "its number of readings")
    n = parse_count(header.rest[end - 1], where, "the number of readings")
    pairs = header.rest[end:]
    if n == 0 or len(pairs) != 2 * n:
        has = f"announces {n} pairs of range and intensity, but has {len(pairs)} fields of them"
        raise InputError(f"{where}: laser line {has}. {MEND}")
    # As floats of Python, which overflow without a warning.
    low, high, step = parse_floats(header.rest[start : start + 3], where).tolist()
    bearing = _bearings(low, high, step, _rounding(header.rest[start + 2]), n, where)
    ranges = parse_floats(pairs[::2], where)
    check_ranges(ranges, where)
    top = float(parse_floats([header.rest[end - 2]], where)[0]) if has_max else np.nan
    return Shot(header.device, header.line, header.time, ranges, bearing, max_range=top, robot=robot)


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
        ring, rest = _geometry(header)
        log.sonars.append(_sonar_shot(header, rest, ring if len(ring) else None))
    elif header.kind == (DATA, 1):
        log.sonars.append(_sonar_shot(header, header.rest, None))
    elif header.kind in ((DATA, 2), (GEOMETRY, 1)):
        ring, rest = _geometry(header)
        if rest:
            raise InputError(f"{header.where}: {len(rest)} fields too many after the transducers. {MEND}")
        log.rings[header.device] = ring
    else:
        log.lines["sonar"] += 1


def _sonar_shot(header: Header, fields: list[bytes], ring: FloatArray | None) -> Shot:
    n = parse_count(fields[0] if fields else b"", header.where, "the number of readings")
    if n == 0 or len(fields) != n + 1:
        raise InputError(f"{header.where}: sonar line announces {n} readings, but has {len(fields) - 1}. {MEND}")
    if ring is not None and len(ring) != n:
        raise InputError(f"{header.where}: sonar line of {n} readings and {len(ring)} transducers. {MEND}")
    ranges = parse_floats(fields[1:], header.where)
    check_ranges(ranges, header.where)
    return Shot(header.device, header.line, header.time, ranges, ring=ring)


def _geometry(header: Header) -> tuple[FloatArray, list[bytes]]:
    """Parse ``n (x y heading)*n`` and return what follows too."""
    fields = header.rest
    n = parse_count(fields[0] if fields else b"", header.where, "the number of transducers")
    if len(fields) < 3 * n + 1:
        has = f"{n} transducers, but has {len(fields) - 1} numbers for them"
        raise InputError(f"{header.where}: sonar line announces {has}. {MEND}")
    ring = parse_floats(fields[1 : 3 * n + 1], header.where).reshape(n, 3)
    check_pose(ring, header.where)
    return ring, fields[3 * n + 1 :]


def _read_position(header: Header, log: PlayerLog) -> None:
    if header.kind not in (None, (DATA, 1)):
        log.lines[header.device.partition(":")[0]] += 1
        return
    header.need(7, "its stall flag")
    log.tracks.setdefault(header.device, []).append((header.line, header.time, header.pose()))
