"""CARMEN logs: ``FLASER``, ``RLASER``, ``ROBOTLASER0`` to ``ROBOTLASER5`` and ``SONAR`` lines.

A line holds one message, and its first field alone names it (comments may hold any of these words)::

    FLASER n r1..rn laser_x laser_y laser_theta robot_x robot_y robot_theta time host logger_time
    RLASER ...                                                                     likewise
    ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n r1..rn m s1..sm
        laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward side [turn_axis] time host logger_time
    SONAR cone_angle num_sonars r1..rn x1 y1 theta1 .. xn yn thetan time host logger_time
    SONAR n r1..rn x y theta odom_x odom_y odom_theta time host logger_time        as GMapping reads it

The laser pose is the pose of the scanner itself, so no ``PARAM robot_frontlaser_offset`` is added again; that of the
rear laser looks backwards already (``construct_laser_message`` in CARMEN's robot_laser.c).

``FLASER`` and ``RLASER`` carry no angles. Beam 0 looks to the right (-pi/2), angles run counter-clockwise; the step is
pi/n for n = 180 or 360 (the last beam is left out), a quarter of a degree over 100 degrees for n = 401 and 400 (a mode
of SICK's scanners), and else pi/(n - 1), as CARMEN assumes (``carmen_laser_guess_angle_increment`` in readlog.c).

A range of exactly 0 is a scanner's error code: dropped and counted. In ``ROBOTLASER`` lines a range at or above the
stated maximum is no return. In the others numbers that mean it (81.91, 51.1, 50 ...) are kept, since they cannot be
distinguished from ranges without the user's maximum.

SONAR lines of the first layout hold the transducers' poses on the robot and no pose of the robot, those of the second
the pose of the robot, with the ring in ``PARAM robot_sonar_offsets x1 y1 theta1 ..``; a first number without a decimal
point marks the second. Without offsets a ring of 8 or 16 is taken for a Pioneer's, with a remark. Lines without a pose
take the robot's from the laser lines (of the first laser), so that both kinds of readings of one log have one
frame; in a log without a laser from ``GLOBALPOS`` (the localizer's), else ``TRUEPOS`` (the simulator's), else ``ODOM``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.logs.poses import CONE, QUARTER_DEGREES, Track, mounted, plain_bearings, ring_of
from prf.logs.readings import FloatArray, Kind, LogNotes, NoReadings, OwnPoses, Readings, Scan, assemble
from prf.logs.text import (
    MEND,
    check_pose,
    check_ranges,
    check_time,
    count_odd_kind,
    is_number,
    parse_count,
    parse_floats,
)
from prf.shell.errors import ConfigError, InputError

ROBOT_LASERS = tuple(f"ROBOTLASER{i}" for i in range(6))
SONAR = "SONAR"
POSE_LINES = ("GLOBALPOS", "TRUEPOS", "ODOM")
POSE_FIELDS = 10
"""Fields of each: kind, six numbers (the pose first), time, host, logger's time."""
LASER_LINES = "laser lines"
POSE_SOURCES = (LASER_LINES, *POSE_LINES)
"""Where the robot's pose at SONAR lines is looked for, in this order."""
KNOWN_KINDS = frozenset(
    (
        *ROBOT_LASERS,
        *(f"RAWLASER{i}" for i in range(6)),
        *("FLASER", "RLASER", "LASER3", "LASER4", "LASER5", "REMISSIONFLASER", "REMISSIONRLASER", "POSITIONLASER"),
        *("PARAM", "SYNC", "NEFF", "MARKER", "BUMPER", "ARM", "IMU", "SCANMARK", "NMEAGGA", SONAR, *POSE_LINES),
        *("NMEARMC", "VECTORMOVE", "ROBOTVELOCITY", "FOLLOWTRAJECTORY", "BASEVELOCITY"),
    )
)
"""First fields of CARMEN's log format; NEFF is an addition of GMapping's."""
OFFSETS = re.compile(rb"\w*sonar_offsets$")
SAME_MOUNT = 1e-3
"""Metres and radians within which a laser sits on the robot alike in all its lines."""


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
        return np.asarray(self.ranges < (self.max_range if self.max_range > 0.0 else np.inf))

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


def read_carmen(
    data: bytes,
    source: str,
    kind: Kind | None = "laser",
    cone: float = CONE,
    device: str | None = None,
    frame: str | None = None,
) -> Readings:
    """Read the readings of a CARMEN log, decompressed; parameters as of :func:`prf.logs.read_readings`.

    Scans are numbered in the order of the file, all lasers together. `device` names a kind of line, `frame` one of
    `POSE_SOURCES` for the robot's pose at SONAR lines.
    """
    if kind != "sonar":
        try:
            return _read_lasers(data, source, device, frame)
        except NoReadings as error:
            if kind == "laser":
                raise
            without_laser = error
    try:
        readings = _read_sonars(data, source, cone, frame)
    except NoReadings:
        if kind is None:
            raise without_laser from None
        raise
    if device not in (None, SONAR):
        raise ConfigError(f"--topic {device}: the sonar readings of {source} are its {SONAR} lines. Leave it out.")
    return readings


def _fields_of_lines(data: bytes, source: str) -> Iterator[tuple[int, str, list[bytes]]]:
    """Yield the number, ``file:line`` and the fields of every line that is not blank."""
    for number, line in enumerate(data.splitlines(), 1):
        fields = line.split()
        if fields:
            yield number, f"{source}:{number}", fields


def _read_lasers(data: bytes, source: str, device: str | None, frame: str | None) -> Readings:
    lines: list[LaserLine] = []
    kinds, odd = Counter[str](), Counter[str]()
    for number, where, fields in _fields_of_lines(data, source):
        kind = fields[0].decode("latin-1")
        if fields[0].startswith(b"#"):
            kinds["comment"] += 1
        elif kind in LASER_PARSERS:
            lines.append(LASER_PARSERS[kind](kind, fields, number, where))
        elif kind in KNOWN_KINDS:
            kinds[kind] += 1
        else:
            count_odd_kind(odd, fields[0])
    if not lines:
        found = ", ".join(f"{n} {kind}" for kind, n in (kinds + odd).most_common(6)) or "nothing"
        why = "no FLASER, RLASER or ROBOTLASER line, the ones that carry a laser pose"
        raise NoReadings(
            f"{source}: CARMEN log with {why}; it has {found}. Use a log with corrected (localized) scans."
        )
    if device is not None and device not in (present := tuple(dict.fromkeys(line.kind for line in lines))):
        raise ConfigError(f"--topic {device}: {source} has {', '.join(present)}.")
    if frame is not None:
        raise OwnPoses(
            f"--frame {frame}: laser lines of {source} carry the laser's pose; a frame can be chosen for SONAR lines "
            "alone. Leave it out."
        )
    lines = lines if device is None else [line for line in lines if line.kind == device]
    reached = [line.max_range for line in lines if line.max_range > 0.0 and not line.is_return.all()]
    sensor_max, remarks = max(reached, default=np.nan), _laser_remarks(lines)
    notes = LogNotes("CARMEN", sensor_max=sensor_max, lines=dict(kinds), odd_lines=dict(odd), remarks=remarks)
    return assemble([line.scan() for line in lines], source, notes)


def _laser_remarks(lines: list[LaserLine]) -> tuple[str, ...]:
    remarks = []
    counts = {len(line.ranges) for line in lines if line.kind in ("FLASER", "RLASER")}
    if narrow := sorted(counts & set(QUARTER_DEGREES)):
        beams = " and ".join(map(str, narrow))
        remarks.append(f"laser lines of {beams} beams carry no angles: 100 degrees in steps of 0.25 are assumed")
    if guessed := sorted(counts - {180, 181, 360, 361, *QUARTER_DEGREES}):
        beams = ", ".join(map(str, guessed[:5]))
        remarks.append(f"laser lines of {beams} beams carry no angles: half a circle is assumed, both ends included")
    turned = [np.cos(line.pose[2] - line.robot[2]) for line in lines if line.kind == "RLASER"]
    if turned and min(turned) > 0:
        remarks.append("the rear laser's heading is the robot's, where CARMEN writes it turned by pi; taken as it is")
    return tuple(remarks)


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
    return LaserLine(kind, number, ranges, bearing, poses[:3], check_time(time, where), poses[3:])


@dataclass
class _SonarLog:
    """Lines gathered for the sonar; `tracks` has (line, time, pose) rows by source of the pose."""

    sonars: list[SonarLine] = field(default_factory=list)
    tracks: dict[str, list[tuple[int, float, FloatArray]]] = field(default_factory=dict)
    laser: str | None = None
    laser_poses: list[FloatArray] = field(default_factory=list)
    ring: FloatArray | None = None
    lines: Counter[str] = field(default_factory=Counter)


def _read_sonars(data: bytes, source: str, cone: float, frame: str | None) -> Readings:
    log = _SonarLog()
    for number, where, fields in _fields_of_lines(data, source):
        if not fields[0].startswith(b"#"):
            _gather(fields, number, where, log, cone)
    if not log.sonars:
        raise NoReadings(f"{source}: CARMEN log without SONAR lines. Use a log with sonar, or a table with cones.")
    poses, known, remarks, where_from = _poses(log, source, frame)
    rings = [_ring(sonar, log, source) for sonar in log.sonars]
    if any(sonar.ring is None for sonar in log.sonars) and log.ring is None:
        remarks.append(f"no offsets of the transducers in the log: a Pioneer's ring of {len(rings[0])} is assumed")
    scans = []
    for sonar, pose, ring, is_known in zip(log.sonars, poses, rings, known, strict=True):
        if is_known:
            at = mounted(pose, ring)
            scans.append(Scan(SONAR, sonar.line, sonar.time, pose, at[:, :2], at[:, 2], sonar.ranges, sonar.cone))
    notes = LogNotes(
        format="CARMEN",
        poses=where_from,
        ring=tuple(map(tuple, rings[0].tolist())),
        lines={kind: n for kind, n in log.lines.items() if kind != SONAR},
        remarks=tuple(remarks),
    )
    return assemble(scans, source, notes)


def _gather(fields: list[bytes], number: int, where: str, log: _SonarLog, cone: float) -> None:
    kind = fields[0].decode("latin-1")
    if kind in KNOWN_KINDS:
        log.lines[kind] += 1
    if kind == SONAR:
        log.sonars.append(_parse_sonar(fields, number, where, cone))
    elif kind in POSE_LINES:
        log.tracks.setdefault(kind, []).append(_parse_pose(fields, number, where))
    elif kind in LASER_PARSERS and log.laser in (None, kind):
        log.laser = kind
        scan = LASER_PARSERS[kind](kind, fields, number, where)
        log.tracks.setdefault(LASER_LINES, []).append((number, scan.time, scan.robot))
        log.laser_poses.append(scan.pose)
    elif kind == "PARAM" and len(fields) > 2 and OFFSETS.match(fields[1]):
        log.ring = _parse_offsets(fields[2:], where)


def _parse_sonar(fields: list[bytes], number: int, where: str, cone: float) -> SonarLine:
    if len(fields) < 3:
        raise InputError(f"{where}: SONAR line ends before its number of readings. {MEND}")
    has_pose = fields[1].isdigit()
    n = parse_count(fields[1] if has_pose else fields[2], where, "the number of readings")
    length = n + 11 if has_pose else 4 * n + 6
    if n == 0 or len(fields) != length:
        has = f"announces {n} readings, which makes {length} fields, but has {len(fields)}"
        raise InputError(f"{where}: SONAR line {has}. {MEND}")
    values = parse_floats((*fields[2 if has_pose else 3 : -2], fields[-3]), where)
    ranges, rest, time = values[:n], values[n:-2], check_time(float(values[-1]), where)
    check_ranges(ranges, where)
    if has_pose:
        check_pose(rest[:3], where)
        return SonarLine(number, ranges, time, cone, rest[:3], None)
    opening = float(parse_floats(fields[1:2], where)[0])
    if not 0 <= opening <= 2 * np.pi:
        raise InputError(f"{where}: cone angle {opening:g}, but must be from 0 to 2 pi. {MEND}")
    check_pose(rest, where)
    return SonarLine(number, ranges, time, opening or cone, None, rest.reshape(n, 3))


def _parse_pose(fields: list[bytes], number: int, where: str) -> tuple[int, float, FloatArray]:
    if len(fields) != POSE_FIELDS:
        raise InputError(f"{where}: line of {len(fields)} fields, where its kind has {POSE_FIELDS}. {MEND}")
    values = parse_floats((*fields[1:4], fields[-3]), where)
    check_pose(values[:3], where)
    return number, check_time(float(values[3]), where), values[:3]


def _parse_offsets(fields: list[bytes], where: str) -> FloatArray:
    """Return the (n, 3) ring of a PARAM line, whose list ends in one to three fields of time and host."""
    n = next((i for i, text in enumerate(fields) if not is_number(text)), len(fields)) // 3
    if n == 0:
        raise InputError(f"{where}: sonar offsets are not x y theta a transducer. {MEND}")
    ring = parse_floats(fields[: 3 * n], where).reshape(n, 3)
    check_pose(ring, where)
    return ring


def _ring(sonar: SonarLine, log: _SonarLog, source: str) -> FloatArray:
    n = len(sonar.ranges)
    if sonar.ring is not None:
        return sonar.ring
    if log.ring is not None and len(log.ring) >= n:
        return log.ring[:n]
    ring = ring_of(n) if log.ring is None else None
    if ring is None:
        why = f"nothing says where its {n} transducers sit"
        raise InputError(
            f"{source}:{sonar.line}: {why}. Add PARAM robot_sonar_offsets x y theta ..., one a transducer."
        )
    return ring


def _poses(log: _SonarLog, source: str, frame: str | None) -> tuple[list[FloatArray], list[bool], list[str], str]:
    """Return pose of the robot and whether it is known, both by SONAR line; remarks; where the poses are from."""
    own = [sonar.pose for sonar in log.sonars if sonar.pose is not None]
    if frame is None and len(own) == len(log.sonars):
        return own, [True] * len(own), [], "in the log"
    name = frame if frame is not None else next((name for name in POSE_SOURCES if name in log.tracks), None)
    if name is None:
        raise InputError(f"{source}: SONAR lines without a pose, and no line that has one ({', '.join(POSE_SOURCES)}).")
    if name not in log.tracks:
        raise ConfigError(f"--frame {name}: {source} has {', '.join(log.tracks) or 'no poses'}.")
    rows, remarks = log.tracks[name], []
    if name == LASER_LINES and not _robot_is_in_laser_frame(log):
        rows = [(line, time, pose) for (line, time, _), pose in zip(rows, log.laser_poses, strict=True)]
        remarks.append("laser lines hold the robot's pose in another frame: the laser's is taken for the robot's")
    if name == "ODOM":
        remarks.append("the poses are the odometry's, which drifts unless the log was corrected")
    track = Track.from_rows(rows)
    times = np.array([sonar.time for sonar in log.sonars])
    pose, known = track.poses_at(np.array([sonar.line for sonar in log.sonars]), times)
    if not known.any():
        raise InputError(f"{source}: no SONAR line lies within the time of the poses ({name}).")
    if not known.all():
        n_lost = np.count_nonzero(~known)
        remarks.append(f"{n_lost} of {len(known)} SONAR lines lie outside the time of the poses: dropped")
    return list(pose), known.tolist(), remarks, f"{name}, {track.how}"


def _robot_is_in_laser_frame(log: _SonarLog) -> bool:
    """Return whether the laser sits at one place of the robot, by the two poses of every laser line."""
    robot = np.array([pose for _, _, pose in log.tracks[LASER_LINES]])
    change = np.array(log.laser_poses) - robot
    cosine, sine = np.cos(robot[:, 2]), np.sin(robot[:, 2])
    ahead, aside = cosine * change[:, 0] + sine * change[:, 1], cosine * change[:, 1] - sine * change[:, 0]
    turn = np.angle(np.exp(1j * (change[:, 2] - change[0, 2])))
    return bool(max(np.ptp(ahead), np.ptp(aside), np.ptp(turn)) < SAME_MOUNT)
