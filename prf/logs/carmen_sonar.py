"""Sonar readings of CARMEN logs: ``SONAR`` lines, with poses from other lines where they carry none.

CARMEN's logger (``carmen_logwrite_write_base_sonar`` in writelog.c) documents, in the header of every log it writes::

    SONAR cone_angle num_sonars r1..rn x1 y1 theta1 .. xn yn thetan time host logger_time

with the transducers' poses on the robot and no pose of the robot. GMapping reads an older layout, like that of FLASER::

    SONAR n r1..rn x y theta odom_x odom_y odom_theta time host logger_time

with the pose of the robot's centre and the ring in ``PARAM robot_sonar_offsets x1 y1 theta1 ..``; CARMEN's own manual
is silent on it. A first number without a decimal point tells the older one. Without offsets a ring of 8 or 16 is taken
for a Pioneer's, with a remark.

Lines without a pose take the robot's from the laser lines (of the first laser), so that both kinds of readings of one
log stand in one frame; in a log without a laser from ``GLOBALPOS`` (the localizer's), else ``TRUEPOS`` (the
simulator's), else ``ODOM``. How it is found for the reading's time: :func:`prf.logs.track.poses_at`.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from prf.logs.carmen import KNOWN_KINDS, LASER_PARSERS
from prf.logs.numbers import MEND, check_pose, check_ranges, check_time, is_number, parse_count, parse_floats
from prf.logs.readings import FloatArray, LogNotes, NoReadings, Readings
from prf.logs.rings import ring_of
from prf.logs.scans import Scan, assemble
from prf.logs.track import Track, mounted, poses_at
from prf.shell.errors import ConfigError, InputError

OFFSETS = re.compile(rb"\w*sonar_offsets$")

SONAR = "SONAR"
POSE_LINES = ("GLOBALPOS", "TRUEPOS", "ODOM")
POSE_FIELDS = 10
"""Fields of each: kind, six numbers (the pose first), time, host, logger's time."""

LASER_LINES = "laser lines"
SOURCES = (LASER_LINES, *POSE_LINES)
"""Where the robot's pose is looked for, in this order."""

SAME_MOUNT = 1e-3
"""Metres and radians within which a laser sits on the robot alike in all its lines."""


class _Sonar(NamedTuple):
    """One SONAR line; `pose` and `ring` are None where it has none."""

    line: int
    ranges: FloatArray
    time: float
    cone: float
    pose: FloatArray | None
    ring: FloatArray | None


@dataclass
class _Log:
    """What has been gathered from the lines so far; `tracks` has (line, time, pose) rows by source of the pose."""

    sonars: list[_Sonar] = field(default_factory=list)
    tracks: dict[str, list[tuple[int, float, FloatArray]]] = field(default_factory=dict)
    laser: str | None = None
    laser_poses: list[FloatArray] = field(default_factory=list)
    ring: FloatArray | None = None
    lines: Counter[str] = field(default_factory=Counter)


def read_carmen_sonar(data: bytes, source: str, cone: float, frame: str | None = None) -> Readings:
    """Read the sonar readings of a CARMEN log.

    Parameters
    ----------
    data : bytes
        The text of the log, decompressed.
    source : str
        Name of the log, for messages.
    cone : float
        Full opening angle in radians for lines without one.
    frame : str, optional
        Where the robot's pose comes from, one of `SOURCES`, if not from the first that the log has.

    Returns
    -------
    Readings
        One scan a line, one beam a transducer.

    Raises
    ------
    InputError
        For a damaged line, and for a log without poses or without geometry of the ring; :class:`NoReadings` for one
        without SONAR lines.
    ConfigError
        If the log has no lines of `frame`.
    """
    log = _Log()
    for number, line in enumerate(data.splitlines(), 1):
        fields = line.split()
        if fields and not fields[0].startswith(b"#"):
            _read_line(fields, number, f"{source}:{number}", log, cone)
    if not log.sonars:
        raise NoReadings(f"{source}: CARMEN log without SONAR lines. Use a log with sonar, or a table with cones.")
    poses, known, remarks, where_from = _poses(log, source, frame)
    rings = [_ring(sonar, log, source) for sonar in log.sonars]
    if any(sonar.ring is None for sonar in log.sonars) and log.ring is None:
        remarks.append(f"no offsets of the transducers in the log: a Pioneer's ring of {len(rings[0])} is assumed")
    scans = [
        _scan(sonar, pose, ring)
        for sonar, pose, ring, is_known in zip(log.sonars, poses, rings, known, strict=True)
        if is_known
    ]
    notes = LogNotes(
        format="CARMEN",
        poses=where_from,
        ring=tuple(map(tuple, rings[0].tolist())),
        lines={kind: n for kind, n in log.lines.items() if kind != SONAR},
        remarks=tuple(remarks),
    )
    return assemble(scans, source, notes)


def _read_line(fields: list[bytes], number: int, where: str, log: _Log, cone: float) -> None:
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


def _parse_sonar(fields: list[bytes], number: int, where: str, cone: float) -> _Sonar:
    if len(fields) < 3:
        raise InputError(f"{where}: SONAR line ends before its number of readings. {MEND}")
    is_old = fields[1].isdigit()
    n = parse_count(fields[1] if is_old else fields[2], where, "the number of readings")
    length = n + 11 if is_old else 4 * n + 6
    if n == 0 or len(fields) != length:
        has = f"announces {n} readings, which makes {length} fields, but has {len(fields)}"
        raise InputError(f"{where}: SONAR line {has}. {MEND}")
    first = 2 if is_old else 3
    values = parse_floats((*fields[first:-2], fields[-3]), where)
    ranges, rest, time = values[:n], values[n:-2], check_time(float(values[-1]), where)
    check_ranges(ranges, where)
    if is_old:
        check_pose(rest[:3], where)
        return _Sonar(number, ranges, time, cone, rest[:3], None)
    opening = float(parse_floats(fields[1:2], where)[0])
    if not 0 <= opening <= 2 * np.pi:
        raise InputError(f"{where}: cone angle {opening:g}, but must be from 0 to 2 pi. {MEND}")
    ring = rest.reshape(n, 3)
    check_pose(ring.reshape(-1), where)
    return _Sonar(number, ranges, time, opening or cone, None, ring)


def _parse_pose(fields: list[bytes], number: int, where: str) -> tuple[int, float, FloatArray]:
    if len(fields) != POSE_FIELDS:
        raise InputError(f"{where}: line of {len(fields)} fields, where its kind has {POSE_FIELDS}. {MEND}")
    values = parse_floats((*fields[1:4], fields[-3]), where)
    check_pose(values[:3], where)
    return number, check_time(float(values[3]), where), values[:3]


def _parse_offsets(fields: list[bytes], where: str) -> FloatArray:
    """Return the (n, 3) ring of a PARAM line, whose list ends in one to three fields of time and host."""
    n_numbers = next((i for i, text in enumerate(fields) if not is_number(text)), len(fields))
    n = n_numbers // 3
    if n == 0:
        raise InputError(f"{where}: sonar offsets are not x y theta a transducer. {MEND}")
    ring = parse_floats(fields[: 3 * n], where).reshape(n, 3)
    check_pose(ring.reshape(-1), where)
    return ring


def _ring(sonar: _Sonar, log: _Log, source: str) -> FloatArray:
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


def _poses(log: _Log, source: str, frame: str | None) -> tuple[list[FloatArray], list[bool], list[str], str]:
    """Return pose of the robot and whether it is known, both by SONAR line; remarks; where the poses come from."""
    own = [sonar.pose for sonar in log.sonars]
    if frame is None and all(pose is not None for pose in own):
        return [pose for pose in own if pose is not None], [True] * len(own), [], "in the log"
    name = frame if frame is not None else next((name for name in SOURCES if name in log.tracks), None)
    if name is None:
        raise InputError(f"{source}: SONAR lines without a pose, and no line that has one ({', '.join(SOURCES)}).")
    if name not in log.tracks:
        raise ConfigError(f"--frame {name}: {source} has {', '.join(log.tracks) or 'no poses'}.")
    rows, remarks = log.tracks[name], []
    if name == LASER_LINES and not _robot_is_in_laser_frame(log):
        rows = [(line, time, pose) for (line, time, _), pose in zip(rows, log.laser_poses, strict=True)]
        remarks.append("laser lines hold the robot's pose in another frame: the laser's is taken for the robot's")
    if name == "ODOM":
        remarks.append("the poses are the odometry's, which drifts unless the log was corrected")
    track = Track.from_rows(rows)
    pose, known = poses_at(
        track, np.array([sonar.line for sonar in log.sonars]), np.array([sonar.time for sonar in log.sonars])
    )
    if not known.any():
        raise InputError(f"{source}: no SONAR line lies within the time of the poses ({name}).")
    if not known.all():
        remarks.append(
            f"{np.count_nonzero(~known)} of {len(known)} SONAR lines lie outside the time of the poses: dropped"
        )
    how = "interpolated in time" if track.has_clock else "the last one before each reading"
    return list(pose), known.tolist(), remarks, f"{name}, {how}"


def _robot_is_in_laser_frame(log: _Log) -> bool:
    """Return whether the laser sits at one place of the robot, by the two poses of every laser line."""
    robot = np.array([pose for _, _, pose in log.tracks[LASER_LINES]])
    change = np.array(log.laser_poses) - robot
    cosine, sine = np.cos(robot[:, 2]), np.sin(robot[:, 2])
    ahead, aside = cosine * change[:, 0] + sine * change[:, 1], cosine * change[:, 1] - sine * change[:, 0]
    turn = np.angle(np.exp(1j * (change[:, 2] - change[0, 2])))
    return bool(max(np.ptp(ahead), np.ptp(aside), np.ptp(turn)) < SAME_MOUNT)


def _scan(sonar: _Sonar, pose: FloatArray, ring: FloatArray) -> Scan:
    where = mounted(pose, ring)
    return Scan(SONAR, sonar.line, sonar.time, pose, where[:, :2], where[:, 2], sonar.ranges, sonar.cone)
