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

So 1.x has no pose of the laser on the robot (taken for the robot's centre) nor its maximum range. In 2.x a range at or
above the stated maximum is no return. The pose of the robot at a reading is that of the position lines
(:class:`prf.readings.poses.Track`), except for (1, 2), which carries it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from prf.readings.poses import Track
from prf.readings.readings import Kind, LogNotes, NoReadings, Readings, Scan, assemble, mounted, ring_of, spread
from prf.readings.text import FloatArray, Parsed, content_lines, expect_length, floats, parse_lines
from prf.shell.errors import ConfigError, InputError

POSITIONS = ("position", "position2d")
DATA, DATA_WITH_POSE, GEOMETRY = (1, 1), (1, 2), (4, 1)
"""Types and subtypes of messages; DATA_WITH_POSE of a sonar is its geometry."""
PRINTED = 0.0005  # metres. Ranges are printed to the millimetre, the maximum range to a tenth of it
NO_MOUNT = np.zeros(3)


class Line(NamedTuple):
    """One line: `kind` is (type, subtype), DATA in 1.x, whose layouts are others; `rest` are the fields that follow."""

    number: int
    interface: str
    device: str
    time: float
    kind: tuple[int, int]
    is_1x: bool
    rest: bytes

    @property
    def is_reading(self) -> bool:
        """Whether it holds readings."""
        kinds = (DATA, DATA_WITH_POSE) if self.interface == "laser" else (DATA,)
        return self.interface in ("laser", "sonar") and self.kind in kinds

    @property
    def is_geometry(self) -> bool:
        """Whether it holds the pose of a sensor on the robot."""
        kinds = (GEOMETRY,) if self.interface == "laser" else (GEOMETRY, DATA_WITH_POSE)
        return self.interface in ("laser", "sonar") and self.kind in kinds

    @property
    def is_pose(self) -> bool:
        """Whether it holds the robot's pose."""
        return self.interface in POSITIONS and self.kind == DATA


class Shot(NamedTuple):
    """A line of readings.

    `bearing` (n,) is a laser's; `ring` (n, 3) a sonar's geometry, if in the line; `max_range` inf where the line has
    none; `robot` the pose in the line, if any.
    """

    line: Line
    ranges: FloatArray
    bearing: FloatArray | None = None
    ring: FloatArray | None = None
    max_range: float = np.inf
    robot: FloatArray | None = None

    @property
    def returns(self) -> FloatArray:
        """Ranges, inf at or above the stated maximum."""
        return np.where(self.ranges >= self.max_range - PRINTED, np.inf, self.ranges)


def read_player(
    data: bytes,
    source: str,
    kind: Kind | None,
    cone: float,
    device: str | None = None,
    frame: str | None = None,
    on_robot: bool = False,
) -> Readings:
    """Read the readings of a Player log, decompressed; parameters as of :func:`prf.readings.read_readings`.

    `device` is one such as ``laser:1`` (default all of the kind), `frame` the position device that gives the robot's
    pose, such as ``position2d:1`` (default the first in the file). `on_robot`: see :mod:`prf.readings.poses`.
    """
    lines = parse_lines(_parse_line, content_lines(data), source)
    present = {line.interface for line in lines if line.is_reading}
    chosen = kind or ("laser" if "laser" in present or "sonar" not in present else "sonar")
    read = [line for line in lines if line.interface == chosen and line.is_reading]
    left = Counter(
        line.device if line.is_pose else line.interface
        for line in lines
        if not line.is_geometry and not (line.is_reading and line.interface == chosen)
    )
    if not read:
        found = ", ".join(f"{n} {name}" for name, n in left.items()) or "no other lines"
        raise NoReadings(f"{source}: Player log without {kind or 'laser or sonar'} readings; it has {found}.")
    if device is not None and device not in (devices := tuple(dict.fromkeys(line.device for line in read))):
        raise ConfigError(f"--topic {device}: {source} has {', '.join(devices)}.")
    read = [line for line in read if device in (None, line.device)]
    parse = _laser_shot if chosen == "laser" else _sonar_shot
    shots = _parse_rest(parse, read, source)
    poses, where_from, remarks = np.zeros((len(shots), 3)), "the robot", list[str]()
    if not on_robot:
        poses, where_from, remarks = _poses(lines, shots, source, frame)
    geometry = [line for line in lines if line.is_geometry and line.interface == chosen]
    notes = LogNotes("Player", poses=where_from, lines=dict(left), remarks=tuple(remarks))
    if chosen == "laser":
        return _lasers(shots, poses, geometry, source, notes)
    return _sonars(shots, poses, geometry, source, cone, notes)


def _parse_line(number: int, fields: list[bytes]) -> Line:
    interface, index = fields[3].decode("ascii"), fields[4].decode("ascii").lstrip("0") or "0"
    head = (number, interface, f"{interface}:{index}")
    if b"." in fields[5]:
        return Line(*head, float(fields[5]), DATA, True, b" ".join(fields[6:]))
    return Line(*head, float(fields[0]), (int(fields[5]), int(fields[6])), False, b" ".join(fields[7:]))


def _parse_rest(parse: Callable[[Line, list[bytes]], Parsed], lines: Sequence[Line], source: str) -> list[Parsed]:
    """Return ``parse(line, fields)`` of what follows the header of each line."""
    at = {line.number: line for line in lines}
    rest = ((number, line.rest) for number, line in at.items())
    return parse_lines(lambda number, fields: parse(at[number], fields), rest, source)


def _laser_shot(line: Line, fields: list[bytes]) -> Shot:
    start = 0 if line.is_1x else 4 if line.kind == DATA_WITH_POSE else 1
    robot = floats(fields[1:4]) if line.kind == DATA_WITH_POSE else None
    end = start + (4 if line.is_1x else 5)
    n = int(fields[end - 1])
    expect_length(fields, (end + 2 * n,), f"{n} pairs of range and intensity")
    low, high, step = floats(fields[start : start + 3]).tolist()
    bearing = _bearings(low, high, step, _rounding(fields[start + 2]), n)
    top = np.inf if line.is_1x or not float(fields[end - 2]) > 0.0 else float(fields[end - 2])
    return Shot(line, floats(fields[end::2]), bearing, max_range=top, robot=robot)


def _rounding(text: bytes) -> float:
    """Return by how much a number may be off that was rounded to the digits of its text."""
    _, point, digits = text.partition(b".")
    return float(0.5 * 10.0 ** -len(digits)) if point and digits.isdigit() else 0.0


def _bearings(low: float, high: float, step: float, rounding: float, n: int) -> FloatArray:
    """Return n angles from `low` on: up to `high` if the step leads there, else up to one step before it, or as it is.

    Logs before Player 1.6 have four digits of the step, 0.0087 for half a degree: 360 of these are half a degree short.
    """
    as_written, span = spread(low, step, n), high - low
    if n > 1 and (abs((n - 1) * step - span) < abs(step) / 2 or abs(span / (n - 1) - step) <= rounding):
        return np.linspace(low, high, n, dtype=np.float64)
    return spread(low, span / n, n) if abs(span / max(n, 1) - step) <= rounding else as_written


def _sonar_shot(line: Line, fields: list[bytes]) -> Shot:
    ring = None
    if line.is_1x:
        ring, fields = _ring(fields)
    n = int(fields[0])
    expect_length(fields, (n + 1,), f"{n} readings")
    return Shot(line, floats(fields[1:]), ring=ring if ring is not None and len(ring) else None)


def _ring(fields: list[bytes]) -> tuple[FloatArray, list[bytes]]:
    """Parse ``n (x y heading)*n`` and return what follows too."""
    n = int(fields[0])
    return floats(fields[1 : 3 * n + 1]).reshape(n, 3), fields[3 * n + 1 :]


def _poses(
    lines: Sequence[Line], shots: Sequence[Shot], source: str, frame: str | None
) -> tuple[FloatArray, str, list[str]]:
    """Return the robot's pose at each shot, nan where it is unknown; where the poses are from; remarks."""
    own = [shot.robot for shot in shots if shot.robot is not None]
    if frame is None and len(own) == len(shots):
        return np.array(own), "in the laser lines", []
    devices = list(dict.fromkeys(line.device for line in lines if line.is_pose))
    if not devices:
        raise InputError(
            f"{source}: no position line gives the pose of the robot. Use a log with position2d lines, "
            "or give a trajectory with --poses."
        )
    name = devices[0] if frame is None else frame
    if name not in devices:
        raise ConfigError(f"--frame {name}: {source} has poses of {', '.join(devices)}.")
    chosen = [line for line in lines if line.is_pose and line.device == name]
    rows = _parse_rest(lambda line, fields: (line.number, line.time, floats(fields[:3])), chosen, source)
    track = Track.from_rows(name, rows, source)
    poses, lost = track.poses_at([shot.line.number for shot in shots], [shot.line.time for shot in shots], source)
    remarks = [f"the poses of {name} are corrected ones: as odometry alone they would drift"]
    if others := [other for other in devices if other != name]:
        remarks.append(f"poses are those of {name}; --frame can choose {', '.join(others)}")
    return poses, track.how, remarks + lost


def _lasers(shots: list[Shot], poses: FloatArray, geometry: list[Line], source: str, notes: LogNotes) -> Readings:
    placed = _parse_rest(lambda line, fields: (line.device, floats(fields[:3])), geometry, source)
    mounts = dict(placed)
    if bare := sorted({shot.line.device for shot in shots} - mounts.keys()):
        missing = f"no pose of {', '.join(bare)} on the robot in the log: the robot's centre is assumed"
        notes = replace(notes, remarks=(*notes.remarks, missing))
    reached = [shot.max_range for shot in shots if shot.max_range < np.inf and np.isinf(shot.returns).any()]
    scans = []
    for shot, robot in zip(shots, poses, strict=True):
        if shot.bearing is not None and not np.isnan(robot[0]):
            at = mounted(robot, mounts.get(shot.line.device, NO_MOUNT))
            angle = at[2] + shot.bearing
            scans.append(Scan(shot.line.device, shot.line.number, shot.line.time, at, at[:2], angle, shot.returns))
    return assemble(scans, source, replace(notes, sensor_max=max(reached, default=np.nan)))


def _sonars(
    shots: list[Shot], poses: FloatArray, geometry: list[Line], source: str, cone: float, notes: LogNotes
) -> Readings:
    placed = dict(_parse_rest(lambda line, fields: (line.device, _ring(fields)[0]), geometry, source))
    rings, assumed = [], {}
    for shot in shots:
        n, device = len(shot.ranges), shot.line.device
        ring = shot.ring if shot.ring is not None else placed.get(device)
        if ring is None:
            ring = ring_of(n)
            assumed[device] = f"no geometry of {device} in the log: a Pioneer's ring of {n} is assumed"
        if ring is None or len(ring) != n:
            why = f"the log does not give the positions of the {n} transducers of {device}"
            raise InputError(f"{source}:{shot.line.number}: {why}. Add a geometry line (sonar 004 001) before it.")
        rings.append(ring)
    scans = []
    for shot, robot, ring in zip(shots, poses, rings, strict=True):
        if not np.isnan(robot[0]):
            at, line = mounted(robot, ring), shot.line
            scans.append(Scan(line.device, line.number, line.time, robot, at[:, :2], at[:, 2], shot.ranges, cone))
    shown = tuple(map(tuple, rings[0].tolist()))
    return assemble(scans, source, replace(notes, ring=shown, remarks=(*assumed.values(), *notes.remarks)))
