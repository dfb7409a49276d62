"""From the lines of a Player log to `Readings`: which pose, which mount, which ranges are returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from prf.logs.player import PRINTED, LaserScan, PlayerLog, SonarScan, parse_player
from prf.logs.readings import FloatArray, Kind, LogNotes, NoReadings, Readings
from prf.logs.rings import ring_of
from prf.logs.scans import Scan, assemble
from prf.logs.track import Track, mounted, poses_at
from prf.shell.errors import ConfigError, InputError

AnyScan = TypeVar("AnyScan", LaserScan, SonarScan)

NO_MOUNT = np.zeros(3)


def read_player(
    data: bytes, source: str, kind: Kind | None, cone: float, device: str | None = None, frame: str | None = None
) -> Readings:
    """Read the laser or sonar readings of a Player log.

    Parameters
    ----------
    data : bytes
        The text of the log, decompressed.
    source : str
        Name of the log, for messages.
    kind : {"laser", "sonar"} or None
        None: laser readings if there are any, else sonar.
    cone : float
        Full opening angle of the sonar, radians: the format has none.
    device : str, optional
        Only the readings of this one, say ``laser:1``; default all of the kind.
    frame : str, optional
        Which position device says where the robot is, say ``position2d:1``; default the first in the file.

    Raises
    ------
    InputError
        For a damaged line, and for a log that does not say where the robot or its sonars are; :class:`NoReadings` if
        there are no readings of the kind.
    ConfigError
        If there is no such device.
    """
    log = parse_player(data, source, ("laser", "sonar") if kind is None else (kind,))
    if log.lasers and kind != "sonar":
        if kind is None:
            log.lines["sonar"] += len(log.sonars)
        return _read_lasers(log, _only(log.lasers, device, source), source, frame)
    if log.sonars:
        return _read_sonars(log, _only(log.sonars, device, source), source, cone, frame)
    found = ", ".join(f"{n} {name}" for name, n in _counts(log).items()) or "no other lines"
    raise NoReadings(f"{source}: Player log without {kind or 'laser or sonar'} readings; it has {found}.")


def _read_lasers(log: PlayerLog, scans: list[LaserScan], source: str, frame: str | None) -> Readings:
    poses, known, where_from, remarks = _poses(log, scans, [scan.robot for scan in scans], source, frame)
    bare = sorted({scan.device for scan in scans} - set(log.mounts))
    if bare:
        remarks.append(f"the log does not say where {', '.join(bare)} sits: the robot's centre is assumed")
    reached = [scan.max_range for scan in scans if scan.max_range > 0 and not _is_return(scan).all()]

    def laser(scan: LaserScan, robot: FloatArray) -> Scan:
        pose = mounted(robot, log.mounts.get(scan.device, NO_MOUNT))
        ranges = np.where(_is_return(scan), scan.ranges, np.inf)
        return Scan(scan.device, scan.line, scan.time, pose, pose[:2], pose[2] + scan.bearing, ranges)

    notes = _notes(log, where_from, remarks, sensor_max=max(reached, default=np.nan))
    return assemble(_placed(laser, scans, poses, known), source, notes)


def _is_return(scan: LaserScan) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which ranges lie below the stated maximum, all if there is no sound one."""
    top = scan.max_range if scan.max_range > 0 else np.inf
    is_return: np.ndarray[tuple[int], np.dtype[np.bool_]] = scan.ranges < top - PRINTED
    return is_return


def _read_sonars(log: PlayerLog, scans: list[SonarScan], source: str, cone: float, frame: str | None) -> Readings:
    rings, remarks = _rings(log, scans, source)
    poses, known, where_from, more = _poses(log, scans, [None] * len(scans), source, frame)
    ring_by_line = {scan.line: ring for scan, ring in zip(scans, rings, strict=True)}

    def sonar(scan: SonarScan, robot: FloatArray) -> Scan:
        where = mounted(robot, ring_by_line[scan.line])
        return Scan(scan.device, scan.line, scan.time, robot, where[:, :2], where[:, 2], scan.ranges, cone)

    notes = _notes(log, where_from, remarks + more, ring=tuple(map(tuple, rings[0].tolist())))
    return assemble(_placed(sonar, scans, poses, known), source, notes)


def _rings(log: PlayerLog, scans: list[SonarScan], source: str) -> tuple[list[FloatArray], list[str]]:
    """Return the ring of every scan, and remarks."""
    rings, remarks = [], {}
    for scan in scans:
        n = len(scan.ranges)
        ring = scan.ring if scan.ring is not None else log.rings.get(scan.device)
        if ring is None:
            ring = ring_of(n)
            remarks[scan.device] = f"no geometry of {scan.device} in the log: a Pioneer's ring of {n} is assumed"
        if ring is None or len(ring) != n:
            why = f"nothing says where the {n} transducers of {scan.device} sit"
            raise InputError(f"{source}:{scan.line}: {why}. Add a geometry line (sonar 004 001) before it.")
        rings.append(ring)
    return rings, list(remarks.values())


def _poses(
    log: PlayerLog, scans: Sequence[AnyScan], own: Sequence[FloatArray | None], source: str, frame: str | None
) -> tuple[list[FloatArray], list[bool], str, list[str]]:
    """Return the robot's pose and whether it is known, both by scan; where the poses come from; remarks."""
    if frame is None and all(pose is not None for pose in own):
        return [pose for pose in own if pose is not None], [True] * len(own), "in the laser lines", []
    name = frame if frame is not None else next(iter(log.tracks), None)
    if name is None:
        raise InputError(f"{source}: no position line says where the robot was. Use a log with position2d lines.")
    if name not in log.tracks:
        raise ConfigError(f"--frame {name}: {source} has poses of {', '.join(log.tracks) or 'no device'}.")
    track = Track.from_rows(log.tracks[name])
    pose, known = poses_at(track, np.array([scan.line for scan in scans]), np.array([scan.time for scan in scans]))
    remarks = [f"the poses of {name} are corrected ones: as odometry alone they would drift"]
    if len(log.tracks) > 1:
        others = ", ".join(other for other in log.tracks if other != name)
        remarks.append(f"the robot is where {name} says; --frame can choose {others}")
    if not known.any():
        raise InputError(f"{source}: no reading lies within the time of the poses ({name}).")
    if not known.all():
        remarks.append(f"{np.count_nonzero(~known)} of {len(known)} scans lie outside the time of the poses: dropped")
    how = "interpolated in time" if track.has_clock else "the last one before each reading"
    return list(pose), known.tolist(), f"{name}, {how}", remarks


def _placed(
    place: Callable[[AnyScan, FloatArray], Scan],
    scans: Sequence[AnyScan],
    poses: Sequence[FloatArray],
    known: Sequence[bool],
) -> list[Scan]:
    return [place(scan, pose) for scan, pose, is_known in zip(scans, poses, known, strict=True) if is_known]


def _only(scans: list[AnyScan], device: str | None, source: str) -> list[AnyScan]:
    devices = tuple(dict.fromkeys(scan.device for scan in scans))
    if device is not None and device not in devices:
        raise ConfigError(f"--topic {device}: {source} has {', '.join(devices)}.")
    return scans if device is None else [scan for scan in scans if scan.device == device]


def _counts(log: PlayerLog) -> dict[str, int]:
    """Return how many lines there are of what was not read as readings."""
    counts = dict(log.lines) | {name: len(rows) for name, rows in log.tracks.items()}
    return {name: n for name, n in counts.items() if n}


def _notes(
    log: PlayerLog,
    where_from: str,
    remarks: list[str],
    sensor_max: float = np.nan,
    ring: tuple[tuple[float, float, float], ...] = (),
) -> LogNotes:
    return LogNotes(
        format="Player",
        sensor_max=sensor_max,
        poses=where_from,
        ring=ring,
        lines=_counts(log),
        odd_lines=dict(log.odd_lines),
        remarks=tuple(remarks),
    )
