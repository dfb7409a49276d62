"""Poses of the scans of a log: from lines of the log itself, or from a file (``--poses``) where it has none or worse.

For poses of a file a log is read on the robot first: its beams then begin and point as they do on what carries the
sensor, and the place of the sensor there is in `ScanTable.pose`. The poses of the file put it into the world.

Scans are matched by time where both have clocks: the pose is interpolated between the two round the scan, linearly and
along the shorter turn, unless these lie farther apart than `gap`; scans outside are dropped and counted. Without times,
or if the two clocks share no second, pose i is that of scan i, and there must be as many of one as of the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from prf.readings.readings import Readings, ScanTable, mounted
from prf.readings.text import FloatArray, IntArray, check_domains
from prf.shell.cli.files import STREAM
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.files import Order, PoseFile, in_seconds, interpolate, read_pose_file, rigid
from prf.shell.poses.tf import HOLD

MAX_TIES = 0.1  # share of equal time stamps up to which a clock is fine enough to interpolate by it
SAME_TIME = 0.01  # seconds: a scan so near to a pose has it, since files round their times
FEW = 0.002  # share of scans that a trajectory of another clock or in another unit places by chance
CLIMB = 1.0  # metres upward, as no robot on one floor goes; of a camera z is ahead
TILT, LYING = np.cos(np.radians(5.0)), np.cos(np.radians(45.0))
"""Upward share of a z axis below which a remark is due, and below which poses are those of a camera or the like."""


class Track(NamedTuple):
    """Poses of a robot, one a line of the log."""

    name: str  # where they are from, for a person
    line: IntArray  # (n,) line of the file, growing
    time: FloatArray  # (n,) seconds
    pose: FloatArray  # (n, 3) position in metres and heading in radians

    @classmethod
    def from_rows(cls, name: str, rows: Sequence[tuple[int, float, FloatArray]], source: str) -> Track:
        """Return the track of (line, time, pose) rows, at least one."""
        line, time, pose = (np.array(column) for column in zip(*rows, strict=True))
        check_domains(source, line, {"t": time, **dict(zip(("x", "y", "theta"), pose.T, strict=True))}, nan=())
        return cls(name, line, time, pose)

    @property
    def has_clock(self) -> bool:
        """Whether the time stamps are fit to interpolate by: they never run backward and few are equal."""
        steps = np.diff(self.time)
        return bool(len(steps) and (steps >= 0).all() and np.count_nonzero(steps == 0) <= MAX_TIES * len(steps))

    @property
    def how(self) -> str:
        """How poses are found, for a person."""
        return f"{self.name}, " + ("interpolated in time" if self.has_clock else "the last one before each reading")

    def poses_at(self, line: Sequence[int], time: Sequence[float], source: str) -> tuple[FloatArray, list[str]]:
        """Return where the robot was at readings (m, 3), heading not wrapped, nan where unknown, and remarks.

        With a fit clock the pose is interpolated between the poses before and after the reading's time, linearly and
        along the shorter turn, and held for `HOLD` seconds beyond the ends. Without one it is the last pose in the file
        before the reading.
        """
        if self.has_clock:
            found, known = self._interpolated(np.array(time))
        else:
            before = np.searchsorted(self.line, line) - 1
            found, known = self.pose[np.maximum(before, 0)], before >= 0
        if not known.any():
            raise InputError(f"{source}: no reading lies within the time of the poses ({self.name}).")
        n_lost = np.count_nonzero(~known)
        lost = f"{n_lost} of {len(known)} scans lie outside the time of the poses: dropped"
        return np.where(known[:, None], found, np.nan), [lost] if n_lost else []

    def _interpolated(self, time: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        pose = self.pose.copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        # Of equal time stamps the last pose counts.
        last = np.r_[np.diff(self.time) > 0, True]
        stamps, pose = self.time[last], pose[last]
        found = np.column_stack([np.interp(time, stamps, column) for column in pose.T])
        return found, (time >= stamps[0] - HOLD) & (time <= stamps[-1] + HOLD)


@dataclass(frozen=True)
class GivenPoses:
    """Poses for the scans of a log, and how they belong to them.

    `mount`: x, y and theta of the sensor (of a ring of sonars: of the robot) in the frame of the poses; None: as the
    log has it. `gap`: seconds between poses, up to which a robot is taken to go straight from one to the next.
    `offset`: seconds added to the times of the poses. `odometry`: of the same body by itself, of which steps count.
    """

    trajectory: PoseFile
    source: str
    gap: float
    mount: tuple[float, float, float] | None = None
    offset: float = 0.0
    odometry: GivenPoses | None = None

    @property
    def times(self) -> FloatArray | None:
        """Times of the poses (k,) by the clock of the scans, seconds."""
        return None if self.trajectory.times is None else self.trajectory.times + self.offset


def read_poses(
    path: str,
    gap: float,
    mount: tuple[float, float, float] | None = None,
    offset: float = 0.0,
    quaternion: Order | None = None,
    is_odometry: bool = False,
) -> GivenPoses:
    """Read the poses of a file, which belong to scans as :class:`GivenPoses` says.

    `is_odometry`: of a file of several arrays take that one.
    """
    trajectory = read_pose_file(path, quaternion, "readings.pose_quaternion", is_odometry)
    return GivenPoses(trajectory, "standard input" if path == STREAM else path, gap, mount, offset)


def true_poses(path: str, scan: IntArray, time: FloatArray, gap: float) -> FloatArray:
    """Return the poses (n, 3) of a file for scans (n,) of a log, by their times (n,) or by order; nan where unknown.

    By order the file has a pose for each of them, or for each scan of the log. InputError if they belong to others.
    """
    poses = read_poses(path, gap)
    n, known = len(scan), poses.trajectory.poses
    if poses.times is None and len(known) != n and len(known) > scan.max(initial=-1):
        poses = replace(poses, trajectory=poses.trajectory._replace(poses=known[scan], names=None))
    table = ScanTable(scan, scan, np.ones(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3)), time)
    found = _matched(table, poses, "the run")[0]
    return np.column_stack([found[:, :2, 3], np.arctan2(found[:, 1, 0], found[:, 0, 0])])


def placed(readings: Readings, poses: GivenPoses) -> Readings:
    """Return readings on the robot, whole, in the world; InputError if the poses do not belong to them."""
    notes, scans, source = readings.notes, readings.notes.scans, readings.source
    found, how, warnings = _matched(scans, poses, source)
    known, steps = np.isfinite(found[:, 0, 0]), None
    if poses.odometry is not None:
        steps, _, further = _matched(scans, poses.odometry, source)
        known &= np.isfinite(steps[:, 0, 0])
        warnings += further
    upward = np.abs(found[known, 2, 2])
    along_x, along_y, climbed = np.ptp(found[known, :3, 3], axis=0)
    if np.median(upward) < LYING or climbed > max(CLIMB, 0.5 * np.hypot(along_x, along_y)):
        raise InputError(
            f"{poses.source}: these poses lie on their side or climb {climbed:.1f} m, as those of a camera do. Give "
            "poses of a robot or a laser, with x ahead and z up."
        )
    if upward.min() < TILT:
        warnings.append(
            f"poses are tilted by up to {np.degrees(np.arccos(upward.min())):.0f} degrees: projected to the plane"
        )
    beams, seats = (readings.origin, readings.angle), (scans.pose[:, :2], scans.pose[:, 2])
    if poses.mount is not None:
        is_ring = bool(readings.cone.any())
        if len(notes.devices) > 1 and not is_ring:
            which = f"{source} has {', '.join(notes.devices)}"
            raise ConfigError(f"readings.pose_mount: {which}; choose the one that sits there with --topic.")
        change = _mount_change(np.array(poses.mount), np.zeros(3) if is_ring else scans.pose[0])[None]
        beams, seats = _moved(change, *beams), _moved(change, *seats)
    row = np.searchsorted(scans.number, readings.scan)
    origin, angle = _moved(found[row, :2], *beams)
    where, heading = _moved(found[:, :2], *seats)
    number, line, n_beams, device = (
        column[known] for column in (scans.number, scans.line, scans.n_beams, scans.device)
    )
    driven = None if steps is None else np.column_stack(_moved(steps[:, :2], *seats))[known]
    pose, time = np.column_stack([where, heading])[known], scans.time[known]
    table = ScanTable(number, line, n_beams, device, pose, time, driven)
    check_domains(poses.source, table.number, {"x": table.pose[:, 0], "y": table.pose[:, 1]})
    layout = f"{poses.trajectory.layout}, {len(poses.trajectory.poses)} poses"
    words = f"{poses.source} ({layout}) {how}, {_of_what(readings, poses)}"
    notes = replace(notes, scans=table, poses=words, warnings=(*notes.warnings, *warnings))
    return replace(readings, origin=origin, angle=angle, notes=notes).where(known[row])


def _of_what(readings: Readings, poses: GivenPoses) -> str:
    """Return in words what the poses are taken for, and where the sensor sits on it."""
    if poses.mount is not None:
        return "the sensor at x {:g} y {:g} theta {:g} of them by readings.pose_mount".format(*poses.mount)
    scans, notes = readings.notes.scans, readings.notes
    sites = {notes.devices[device]: pose for device, pose in zip(scans.device, scans.pose, strict=True)}
    off = [f"{name} sits at x {p[0]:g} y {p[1]:g} theta {p[2]:g} on it" for name, p in sites.items() if p.any()]
    return f"taken as those of {notes.poses}" + "".join(f"; {each}" for each in off[:3])


def _mount_change(new: FloatArray, old: FloatArray) -> FloatArray:
    """Return the motion (2, 4) of beams on the robot that takes a sensor from one place (3,) on it to another."""
    turn = new[2] - old[2]
    c, s = np.cos(turn), np.sin(turn)
    x, y, _ = mounted(np.array([new[0], new[1], turn]), np.array([-old[0], -old[1], 0.0]))
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y]])


def _moved(motion: FloatArray, xy: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return places (n, 2) and directions (n,) in the plane after motions (n, 2, 4) or (1, 2, 4), laid flat."""
    cosine, sine = np.cos(angle), np.sin(angle)
    ahead = motion[:, :, 0] * cosine[:, None] + motion[:, :, 1] * sine[:, None]
    where = motion[:, :, 0] * xy[:, :1] + motion[:, :, 1] * xy[:, 1:] + motion[:, :, 3]
    return where, np.arctan2(ahead[:, 1], ahead[:, 0])


def _matched(scans: ScanTable, poses: GivenPoses, source: str) -> tuple[FloatArray, str, list[str]]:
    """Return the poses (n, 4, 4) of the scans, nan where unknown; how they were found; warnings."""
    known, names = poses.trajectory.poses, poses.trajectory.names
    why_not = _why_not_by_time(scans, poses, source)
    if not why_not:
        found, warnings = _by_time(scans, poses)
        if np.isfinite(found[:, 0, 0]).sum() >= min(len(found), max(FEW * len(found), 2)):
            return found, "matched by time", warnings
        why_not = _why_apart(scans, poses, source)
    if len(known) != len(scans.number):
        counts = f"{source} has {len(scans.number)} scans, {poses.source} {len(known)} poses"
        advice = "Give one pose a scan, or times in both (TUM, CSV t,x,y,theta)."
        raise InputError(f"{why_not}; nor by order: {counts}. {advice}")
    if names is not None and all(name[1:].isdigit() for name in names):  # of g2o
        known = known[np.argsort([int(name[1:]) for name in names], kind="stable")]
    warnings = [] if poses.times is None else [f"{why_not}; as many poses as scans: matched by order"]
    return known, "matched by order", warnings


def _why_not_by_time(scans: ScanTable, poses: GivenPoses, source: str) -> str:
    """Return why scans and poses cannot be matched by time, empty if they can."""
    if poses.times is None:
        return f"{poses.source} has no times"
    if np.isnan(scans.time).all():
        return f"the scans of {source} have no times"
    clocks = [(poses.times, poses.source), *((scans.time[scans.device == d], source) for d in np.unique(scans.device))]
    for time, name in clocks:
        if len(np.unique(time)) < (1.0 - MAX_TIES) * len(time):
            return f"many times of {name} are equal, too coarse to match by"
    return ""


def _by_time(scans: ScanTable, poses: GivenPoses) -> tuple[FloatArray, list[str]]:
    """Return the poses (n, 4, 4) at the times of the scans, nan where there is none, and warnings."""
    assert poses.times is not None
    found, n_outside = _interpolated(poses, poses.times, in_seconds(scans.time))
    n_lost = int(np.count_nonzero(np.isnan(found[:, 0, 0])))
    parts = {f"outside the time of {poses.source}": n_outside}
    parts[f"between poses more than readings.pose_gap = {poses.gap:g} s apart"] = n_lost - n_outside
    words = " and ".join(f"{n} {where}" for where, n in parts.items() if n)
    return found, [f"{n_lost} of {len(found)} scans have no pose and are dropped: {words}"] if n_lost else []


def _why_apart(scans: ScanTable, poses: GivenPoses, source: str) -> str:
    """Return why hardly any scan has a pose by time, and what to do."""
    assert poses.times is not None
    time = in_seconds(scans.time)
    first, last, start, end = np.nanmin(time), np.nanmax(time), poses.times.min(), poses.times.max()
    if first <= end and last >= start:
        why, change = (
            f"hardly any scan lies between two poses at most {poses.gap:g} s apart",
            "readings.pose_gap=SECONDS",
        )
    else:
        why, change = "they hardly overlap", f"readings.pose_offset={first - start + poses.offset:.3f}"
    return (
        f"times of {poses.source} are {start:.3f} to {end:.3f} s, of {source} {first:.3f} to {last:.3f} s, and {why}: "
        f"give seconds of one clock, or --set {change}"
    )


def _interpolated(poses: GivenPoses, times: FloatArray, at: FloatArray) -> tuple[FloatArray, int]:
    """Return the poses (n, 4, 4) at times `at`, nan where unknown, and how many of these are outside of `times`."""
    order = np.argsort(times, kind="stable")
    order = order[np.r_[np.diff(times[order]) > 0.0, True]]  # of equal times the last pose counts
    stamps, known = times[order], poses.trajectory.poses[order]
    inside = (at >= stamps[0] - SAME_TIME) & (at <= stamps[-1] + SAME_TIME)
    when = np.clip(np.where(np.isnan(at), stamps[0], at), stamps[0], stamps[-1])
    after = np.clip(np.searchsorted(stamps, when), 1, max(len(stamps) - 1, 1)).clip(max=len(stamps) - 1)
    before = np.maximum(after - 1, 0)
    distance = np.minimum(np.abs(when - stamps[before]), np.abs(when - stamps[after]))
    usable = inside & ((stamps[after] - stamps[before] <= poses.gap) | (distance <= SAME_TIME))
    places, turns = interpolate(stamps, known[:, :3, 3], Rotation.from_matrix(known[:, :3, :3]), when)
    found = rigid(turns.as_matrix(), places)
    found[~usable] = np.nan
    return found, int(np.count_nonzero(~inside))
