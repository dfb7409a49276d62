"""CARMEN logs: ``FLASER``, ``RLASER``, ``ROBOTLASER0`` to ``ROBOTLASER5`` and ``SONAR`` lines.

The laser pose is the pose of the scanner itself, so no ``PARAM robot_frontlaser_offset`` is added again; that of the
rear laser looks backwards already (``construct_laser_message`` in CARMEN's robot_laser.c).

``FLASER`` and ``RLASER`` carry no angles. Beam 0 looks to the right (-pi/2), angles run counter-clockwise; the step is
pi/n for n = 180 or 360 (the last beam is left out), a quarter of a degree over 100 degrees for n = 401 and 400 (a mode
of SICK's scanners), and else pi/(n - 1), as CARMEN assumes (``carmen_laser_guess_angle_increment`` in readlog.c).

A line holds one message, and its first field alone names it (comments may hold any of these words)::

    FLASER n r1..rn laser_x laser_y laser_theta robot_x robot_y robot_theta time host logger_time
    RLASER ...                                                                     likewise
    ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n r1..rn m s1..sm
        laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward side [turn_axis] time host logger_time
    RAWLASER1 type start_angle ... n r1..rn m s1..sm time host logger_time         as ROBOTLASER1, without poses
    SONAR cone_angle num_sonars r1..rn x1 y1 theta1 .. xn yn thetan time host logger_time
    SONAR n r1..rn x y theta odom_x odom_y odom_theta time host logger_time        as GMapping reads it

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
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.sensors import CONE
from prf.readings.poses import Track
from prf.readings.readings import (
    QUARTER_DEGREES,
    Kind,
    LogNotes,
    NoReadings,
    OwnPoses,
    Readings,
    Scan,
    assemble,
    mounted,
    plain_bearings,
    ring_of,
    seen_from,
    spread,
)
from prf.readings.text import FloatArray, expect_length, floats, parse_lines
from prf.shell.errors import ConfigError, InputError

PLAIN_LASERS = ("FLASER", "RLASER")
LASERS = (*PLAIN_LASERS, *(f"ROBOTLASER{i}" for i in range(6)))
DP_SLAM = "Laser"
RAW_LASERS = (*(f"RAWLASER{i}" for i in range(6)), DP_SLAM)
SONAR = "SONAR"
NOWHERE = np.zeros(3)
RAW_ODOMETRY = "Odometry"  # of DP-SLAM: x y theta before each Laser line, without a time
POSE_LINES = ("GLOBALPOS", "TRUEPOS", "ODOM")
LASER_LINES = "laser lines"
COMMENT = "comment"
KNOWN_KINDS = frozenset(
    (
        *LASERS,
        *RAW_LASERS[:-1],
        *("LASER3", "LASER4", "LASER5", "REMISSIONFLASER", "REMISSIONRLASER", "POSITIONLASER"),
        *("PARAM", "SYNC", "NEFF", "MARKER", "BUMPER", "ARM", "IMU", "SCANMARK", "NMEAGGA", SONAR, *POSE_LINES),
        *("NMEARMC", "VECTORMOVE", "ROBOTVELOCITY", "FOLLOWTRAJECTORY", "BASEVELOCITY"),
    )
)
"""First fields of CARMEN's log format; NEFF is an addition of GMapping's."""
FRONT = re.compile(rb"\s*PARAM\s+robot_frontlaser_(side_|angular_|)offset\s+([-+\d.eE]+)")
"""Where the laser of RAWLASER1 lines sits on the robot: ahead, aside, turned."""
OFFSETS = re.compile(rb"\s*PARAM\s+\w*sonar_offsets\s+((?:[-+\d.eE]+(?:\s+|$))+)")  # time and host may follow
MOST_ODD = 20  # unknown kinds of line that are listed; a damaged file may have thousands
SAME_MOUNT = 1e-3  # metres and radians within which a laser sits on the robot alike in all its lines

Lines = dict[str, list[tuple[int, bytes]]]
"""Numbers and text of the lines of each kind."""


def read_carmen(
    data: bytes,
    source: str,
    kind: Kind | None = "laser",
    cone: float = CONE,
    device: str | None = None,
    frame: str | None = None,
    on_robot: bool = False,
    odometry: bool = False,
) -> Readings:
    """Read the readings of a CARMEN log, decompressed; parameters as of :func:`prf.readings.read_readings`.

    Scans are numbered in the order of the file, all lasers together. `device` names a kind of line, `frame` what gives
    the robot's pose at SONAR lines: "laser lines" or one of `POSE_LINES`; with `odometry` these at laser lines too.
    `on_robot`: see ``poses.py``; then, or with `odometry` in the log, lines of a laser without a pose are read
    if there are no others: RAWLASER, and ``Laser n r1..rn`` of DP-SLAM.
    """
    lines = _lines_by_kind(data)
    lasers = [name for name in lines if name in LASERS]
    if not lasers and not on_robot and odometry and frame is None:
        frame = next((name for name in (RAW_ODOMETRY, "ODOM") if name in lines), None)
    if not lasers and (on_robot or (odometry and frame is not None)):
        lasers = [name for name in lines if name in RAW_LASERS]
    if kind != "sonar" and lasers:
        return _read_lasers(lines, lasers, source, device, frame, on_robot, odometry)
    if kind == "laser" or (kind is None and SONAR not in lines):
        by_number = sorted(lines.items(), key=lambda item: -len(item[1]))
        found = ", ".join(f"{len(group)} {name}" for name, group in by_number[:6]) or "nothing"
        why = "no FLASER, RLASER or ROBOTLASER line, the ones that carry a laser pose"
        raise NoReadings(
            f"{source}: CARMEN log with {why}; it has {found}. Use a log with corrected (localized) scans, "
            "or give their trajectory with --poses."
        )
    if SONAR not in lines:
        raise NoReadings(f"{source}: CARMEN log without SONAR lines. Use a log with sonar, or a table with cones.")
    if device not in (None, SONAR):
        raise ConfigError(f"--topic {device}: the sonar readings of {source} are its {SONAR} lines. Leave it out.")
    return _read_sonars(lines, lasers, source, cone, frame, on_robot)


def _lines_by_kind(data: bytes) -> Lines:
    """Return the lines that are not blank by their first field, comments together."""
    lines: Lines = {}
    for number, line in enumerate(data.splitlines(), 1):
        if first := line.split(None, 1)[:1]:
            kind = COMMENT if first[0].startswith(b"#") else first[0][:24].decode("ascii", "backslashreplace")
            lines.setdefault(kind, []).append((number, line))
    return lines


def _counts(lines: Lines, read: Sequence[str]) -> tuple[dict[str, int], dict[str, int]]:
    """Return how many lines were not read, of known kinds and of the most frequent unknown ones."""
    left = {kind: len(group) for kind, group in lines.items() if kind not in read}
    odd = sorted((item for item in left.items() if item[0] not in KNOWN_KINDS | {COMMENT}), key=lambda item: -item[1])
    known = {kind: n for kind, n in left.items() if kind in KNOWN_KINDS | {COMMENT}}
    return known, dict(odd[:MOST_ODD])


def _read_lasers(
    lines: Lines,
    lasers: list[str],
    source: str,
    device: str | None,
    frame: str | None,
    on_robot: bool,
    odometry: bool,
) -> Readings:
    if device is not None and device not in lasers:
        raise ConfigError(f"--topic {device}: {source} has {', '.join(lasers)}.")
    if frame is not None and not odometry:
        raise OwnPoses(
            f"--frame {frame}: laser lines of {source} carry the laser's pose; a frame can be chosen for SONAR lines "
            "alone, or with sample --odometry. Leave it out."
        )
    present = [name for name in (*POSE_LINES, RAW_ODOMETRY) if name in lines]
    if frame is not None and frame not in present:
        raise ConfigError(f"--frame {frame}: {source} has {', '.join(present) or 'no lines of poses'}.")
    chosen = lasers if device is None else [device]
    merged = sorted(row for kind in chosen for row in lines[kind])
    found = parse_lines(parse_laser, merged, source)
    reached = [line.max_range for line in found if line.max_range > 0.0 and not line.is_return.all()]
    top = max(reached, default=np.nan)
    known, odd = _counts(lines, [*lasers, *([] if frame is None else [frame])])
    notes = LogNotes("CARMEN", sensor_max=top, lines=known, odd_lines=odd, remarks=_laser_remarks(found))
    if frame is not None:
        found, how, remarks = _in_frame(found, lines, frame, source)
        notes = replace(notes, poses=how, remarks=(*notes.remarks, *remarks))
    if on_robot:
        found = _on_robot(found, lines)
        notes = replace(notes, poses="the robot" if any(line.pose.any() for line in found) else "the laser")
    return assemble([line.scan() for line in found], source, notes)


def _in_frame(found: list[LaserLine], lines: Lines, frame: str, source: str) -> tuple[list[LaserLine], str, list[str]]:
    """Return the lines with poses by those of the robot of another kind of line; where these are from; remarks."""
    track = _track(lines, frame, source)
    robot, lost = track.poses_at([line.line for line in found], [line.time for line in found], source)
    posed = [
        line._replace(pose=mounted(pose, line.pose))
        for line, pose in zip(_on_robot(found, lines), robot, strict=True)
        if not np.isnan(pose[0])
    ]
    return posed, track.how, [*_drift_remarks(frame), *lost]


def _track(lines: Lines, name: str, source: str) -> Track:
    """Return the poses of the robot by lines of a kind."""
    clock = name != RAW_ODOMETRY
    rows = parse_lines(
        lambda at, fields: (at, float(fields[7]) if clock else 0.0, floats(fields[1:4])), lines[name], source
    )
    return Track.from_rows(name, rows, source)


def _drift_remarks(name: str) -> list[str]:
    if name not in ("ODOM", RAW_ODOMETRY):
        return []
    return ["the poses are the odometry's, which drifts unless the log was corrected"]


def _on_robot(found: list[LaserLine], lines: Lines) -> list[LaserLine]:
    """Return the lines with the place of the laser on the robot for its pose: by its lines, or by PARAM."""
    places = dict.fromkeys((line.kind for line in found), np.zeros(3))
    for kind in places:
        of_kind = [line for line in found if line.kind == kind]
        if kind == "RAWLASER1":
            given = {match[1]: match[2] for _, line in lines.get("PARAM", []) if (match := FRONT.match(line))}
            places[kind] = floats([given.get(axis, b"0") for axis in (b"", b"side_", b"angular_")])
        elif kind in LASERS and _robot_is_in_laser_frame(of_kind):
            places[kind] = seen_from(of_kind[0].robot, of_kind[0].pose)
    return [line._replace(pose=places[line.kind]) for line in found]


def _laser_remarks(lines: list[LaserLine]) -> tuple[str, ...]:
    remarks = []
    counts = {len(line.ranges) for line in lines if line.kind in PLAIN_LASERS}
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


def _read_sonars(
    lines: Lines, lasers: list[str], source: str, cone: float, frame: str | None, on_robot: bool
) -> Readings:
    sonars = parse_lines(lambda number, fields: parse_sonar(number, fields, cone), lines[SONAR], source)
    poses, remarks, where_from = np.zeros((len(sonars), 3)), list[str](), "the robot"
    if not on_robot:
        poses, remarks, where_from = _poses(lines, lasers, sonars, source, frame)
    offsets = [found for _, line in lines.get("PARAM", []) if (found := OFFSETS.match(line))]
    numbers = _leading_floats(offsets[-1][1].split()) if offsets else np.empty(0)
    given = numbers[: len(numbers) // 3 * 3].reshape(-1, 3) if offsets else None
    rings = [_ring(sonar, given, source) for sonar in sonars]
    if given is None and any(sonar.ring is None for sonar in sonars):
        remarks.append(f"no offsets of the transducers in the log: a Pioneer's ring of {len(rings[0])} is assumed")
    scans = []
    for sonar, pose, ring in zip(sonars, poses, rings, strict=True):
        if not np.isnan(pose[0]):
            at = mounted(pose, ring)
            scans.append(Scan(SONAR, sonar.line, sonar.time, pose, at[:, :2], at[:, 2], sonar.ranges, sonar.cone))
    known, odd = _counts(lines, (SONAR,))
    shown = tuple(map(tuple, rings[0].tolist()))
    notes = LogNotes("CARMEN", lines=known, odd_lines=odd, poses=where_from, ring=shown, remarks=tuple(remarks))
    return assemble(scans, source, notes)


def _leading_floats(fields: list[bytes]) -> FloatArray:
    """Return the numbers before the first field that is not one: a time and a host, by name or address, may follow."""
    found = []
    for each in fields:
        try:
            found.append(float(each))
        except ValueError:
            break
    return np.array(found)


def _ring(sonar: SonarLine, given: FloatArray | None, source: str) -> FloatArray:
    """Return the ring (n, 3) of a line: its own, that of a PARAM line, or a Pioneer's."""
    n = len(sonar.ranges)
    if sonar.ring is not None:
        return sonar.ring
    ring = ring_of(n) if given is None else given[:n]
    if ring is None or len(ring) < n:
        raise InputError(
            f"{source}:{sonar.line}: the log does not give the positions of its {n} transducers. Add PARAM "
            "robot_sonar_offsets x y theta ..., one a transducer."
        )
    return ring


def _poses(
    lines: Lines, lasers: list[str], sonars: list[SonarLine], source: str, frame: str | None
) -> tuple[FloatArray, list[str], str]:
    """Return the robot's pose at each SONAR line, nan where unknown; remarks; where the poses are from."""
    own = [sonar.pose for sonar in sonars if sonar.pose is not None]
    if frame is None and len(own) == len(sonars):
        return np.array(own), [], "in the log"
    present = [*([LASER_LINES] if lasers else []), *(name for name in POSE_LINES if name in lines)]
    if not present:
        names = ", ".join((LASER_LINES, *POSE_LINES))
        raise InputError(f"{source}: SONAR lines without a pose, and no line that has one ({names}).")
    name = present[0] if frame is None else frame
    if name not in present:
        raise ConfigError(f"--frame {name}: {source} has {', '.join(present)}.")
    remarks = _drift_remarks(name)
    if name == LASER_LINES:
        found = parse_lines(parse_laser, lines[lasers[0]], source)
        one_frame = _robot_is_in_laser_frame(found)
        rows = [(line.line, line.time, line.robot if one_frame else line.pose) for line in found]
        if not one_frame:
            remarks.append("laser lines hold the robot's pose in another frame: the laser's is taken for the robot's")
        track = Track.from_rows(name, rows, source)
    else:
        track = _track(lines, name, source)
    poses, lost = track.poses_at([sonar.line for sonar in sonars], [sonar.time for sonar in sonars], source)
    return poses, remarks + lost, track.how


def _robot_is_in_laser_frame(lines: list[LaserLine]) -> bool:
    """Return whether the laser sits at one place of the robot, by the two poses of every laser line."""
    robot = np.array([line.robot for line in lines])
    change = np.array([line.pose for line in lines]) - robot
    cosine, sine = np.cos(robot[:, 2]), np.sin(robot[:, 2])
    ahead, aside = cosine * change[:, 0] + sine * change[:, 1], cosine * change[:, 1] - sine * change[:, 0]
    turn = np.angle(np.exp(1j * (change[:, 2] - change[0, 2])))
    return bool(max(np.ptp(ahead), np.ptp(aside), np.ptp(turn)) < SAME_MOUNT)


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
        return np.asarray(~(self.ranges >= (self.max_range if self.max_range > 0.0 else np.inf)))

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


def parse_laser(number: int, fields: list[bytes]) -> LaserLine:
    """Return the laser line in the fields of a line (ValueError or IndexError if it is damaged)."""
    kind = fields[0].decode("ascii")
    if kind not in (*PLAIN_LASERS, DP_SLAM):
        return _parse_robot_laser(kind, number, fields)
    n = int(fields[1])
    if kind == DP_SLAM:
        expect_length(fields, (n + 2,), f"{n} readings")
        return LaserLine(kind, number, floats(fields[2:]), plain_bearings(n), NOWHERE, np.nan, NOWHERE)
    expect_length(fields, (n + 11,), f"{n} readings")
    values = floats(fields[2 : n + 9])
    return LaserLine(
        kind, number, values[:n], plain_bearings(n), values[n : n + 3], float(values[-1]), values[n + 3 : n + 6]
    )


def _parse_robot_laser(kind: str, number: int, fields: list[bytes]) -> LaserLine:
    n = int(fields[8])
    m = int(fields[n + 9])
    start, _, step, max_range = floats(fields[2:6]).tolist()
    ranges = floats(fields[9 : n + 9])
    if kind in RAW_LASERS:
        expect_length(fields, (n + m + 13,), f"{n} readings and {m} remission values")
        return LaserLine(kind, number, ranges, spread(start, step, n), NOWHERE, float(fields[-3]), NOWHERE, max_range)
    # The format page of CARMEN has turn_axis, some writers of the format leave it out.
    expect_length(fields, (n + m + 24, n + m + 23), f"{n} readings and {m} remission values")
    poses = floats(fields[n + m + 10 : n + m + 16])
    return LaserLine(kind, number, ranges, spread(start, step, n), poses[:3], float(fields[-3]), poses[3:], max_range)


def parse_sonar(number: int, fields: list[bytes], cone: float) -> SonarLine:
    """Return the SONAR line in the fields of a line, likewise; `cone` where it has none."""
    has_pose = fields[1].isdigit()
    n = int(fields[1] if has_pose else fields[2])
    expect_length(fields, (n + 11 if has_pose else 4 * n + 6,), f"{n} readings")
    time = float(fields[-3])
    if has_pose:
        values = floats(fields[2 : n + 5])
        return SonarLine(number, values[:n], time, cone, values[n:], None)
    values = floats(fields[3:-3])
    return SonarLine(number, values[:n], time, float(fields[1]) or cone, None, values[n:].reshape(n, 3))
