"""Drives whose truth is known and whose poses err: simulated floors and loops, and public logs with errors added."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.commands import made
from prf.configuration import ODOMETRY
from prf.poses.model import step_spread
from prf.poses.plane import compose, seen_from
from prf.readings import read_readings

Floats = NDArray[np.float64]

TUNING, JUDGING = (1, 2, 3), (11, 12, 13, 14, 15)
REAL = {
    "real": {TUNING: ("intel",), JUDGING: ("freiburg-101", "aces", "csail")},
    "beside": {TUNING: ("intel",), JUDGING: ("freiburg-079", "belgioioso", "edmonton", "fhw")},
}
MOST_SCANS = 300  # of a public log, evenly; more take longer and say no more
MOST_FOLLOWED = 1000  # where scans are followed from one to the next
TURNING = 0.02  # radians a radian by which odometry turns too far besides, as that of unequal wheels does
SIZE = [20.0, 14.0]  # metres, of an office


class Case(NamedTuple):
    """What the poses of a drive err by, as options have it."""

    pose_noise: list[float] | None = None
    odometry: str | None = None


LONG = {
    "long": 0.6,
    "repeating": 0.2,
    "ambiguous": 0.6,
}  # by how much rings are larger than those of `loop`, 66 to 98 m
REPEATING = ("repeating", "ambiguous")  # rings that look the same every 4 m
CARRIED = 11.0  # metres that a robot is carried, its wheels standing
CASES = {
    "small": Case([0.05, 0.01]),
    "large": Case([0.15, 0.03]),
    "loop": Case(odometry="wheels"),
    "long": Case(odometry="wheels"),
    "carried": Case(odometry="wheels"),
    "repeating": Case(odometry="wheels"),
    "ambiguous": Case(odometry="poor"),
    "real": Case([0.15, 0.03]),
    "beside": Case([0.5, 0.1], "wheels"),
}


class Drive(NamedTuple):
    """A log whose poses err, and the truth."""

    log: Path
    poses: Path | None  # those that err, where they are not the log's own
    every_scan: int
    truth: Floats  # (n_scans, 3) of all scans of the log
    odometry: Path | None = None  # beside poses


def ring(rng: np.random.Generator, larger: float, is_repeating: bool) -> tuple[shapely.Geometry, shapely.LinearRing]:
    """Return the walls of a ring of corridors with niches and pillars, and the way once round it.

    In a repeating one all niches are the same and stand at the same distances.
    """
    wide, high, across = *((1.0 + larger) * rng.uniform([24.0, 14.0], [32.0, 22.0])), rng.uniform(2.2, 3.0)
    low = 0.5 * across
    free = [shapely.box(0, 0, wide, high).difference(shapely.box(across, across, wide - across, high - across))]
    way = shapely.LinearRing([(low, low), (wide - low, low), (wide - low, high - low), (low, high - low)])
    pillars, same = [], (rng.uniform(0.4, 1.2), *(low + rng.uniform(0.2, 1.2, 2)))
    for along in np.arange(3.0, way.length, 4.0):  # 4 m apart, so that none touch
        shift, half, left, right = rng.uniform(-0.5, 0.5), rng.uniform(0.4, 1.2), *(low + rng.uniform(0.2, 1.2, 2))
        if is_repeating:
            shift, (half, left, right) = 0.0, same
        x, y = way.interpolate(along + shift).coords[0]
        is_upright = low < y < high - low
        reach = (left, half, right, half) if is_upright else (half, left, half, right)
        free.append(shapely.box(x - reach[0], y - reach[1], x + reach[2], y + reach[3]))
        aside = rng.choice([-1.0, 1.0], 2) * (low - 0.35)
        pillar = shapely.Point(x + aside[0], y + aside[1])
        if pillar.distance(way) > 0.45 and not is_repeating:
            pillars.append(pillar.buffer(rng.uniform(0.1, 0.2), quad_segs=2))
    walls = shapely.box(-3, -3, wide + 3, high + 3).difference(shapely.union_all(free))
    return shapely.union_all([walls, *pillars]), way


def loop_world(folder: Path, name: str, seed: int) -> tuple[Path, Path]:
    """Write a ring of corridors, and waypoints once round it and a bit; return both files."""
    walls, way = ring(np.random.default_rng(seed), LONG.get(name, 0.0), name in REPEATING)
    world, path = folder / "world.geojson", folder / "way.csv"
    folder.mkdir(parents=True, exist_ok=True)
    world.write_text(shapely.to_geojson(walls))
    stops = [*way.coords, way.interpolate(8.0).coords[0]]
    path.write_text("x,y\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in stops))
    return world, path


def carry(log: Path, truth: Floats, seed: int) -> Floats:
    """Leave out of a log of odometry the scans of CARRIED metres, as if the wheels had stood; return the rest's truth.

    Where it is taken up is between a third and half of the way.
    """
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T)))
    first = int(np.searchsorted(along, along[-1] * np.random.default_rng(seed).uniform(1 / 3, 1 / 2)))
    last = int(np.searchsorted(along, along[first] + CARRIED))
    pose = read_readings(str(log)).notes.scans.pose.copy()
    pose[last:] = compose(pose[[first - 1]], seen_from(pose[[last]], pose[last:]))
    kept = np.delete(np.arange(len(truth)), np.arange(first, last))
    lines = gzip.decompress(log.read_bytes()).decode().splitlines()
    log.write_bytes(gzip.compress("\n".join(_placed(lines, pose, set(kept.tolist()))).encode() + b"\n"))
    return truth[kept]


def _placed(lines: list[str], pose: Floats, kept: set[int]) -> Iterator[str]:
    """Yield lines of a CARMEN log, the scans kept at other poses (n, 3)."""
    number = 0
    for line in lines:
        word = line.split()
        if word[:1] != ["FLASER"]:
            yield line
            continue
        if number in kept:
            at, n = [f"{value:.6f}" for value in pose[number]], 2 + int(word[1])
            yield " ".join([*word[:n], *at, *at, *word[n + 6 :]])
        number += 1


def simulated(folder: Path, name: str, seed: int) -> Drive:
    """Simulate a drive whose log has poses with errors."""
    case, output = CASES[name], folder / "drive"
    if case.odometry is not None:
        world, path = loop_world(folder, name, seed)
        made("simulate", output, world=world, path=path, odometry=case.odometry, seed=seed)
    else:
        made("simulate", output, size=SIZE, pose_noise=case.pose_noise, seed=seed)
    log, truth = output / "laser.log.gz", np.loadtxt(output / "true_poses.csv", delimiter=",", skiprows=1)[:, 1:]
    return Drive(log, None, 1, carry(log, truth, seed) if name == "carried" else truth)


def disturbed(folder: Path, log: Path, case: Case, seed: int) -> Drive:
    """Write poses of a log with errors added, one for each scan; the log's own are the truth.

    So is odometry beside them, where the case has it: their steps with errors of wheels.
    """
    truth = read_readings(str(log)).notes.scans.pose
    place, heading = case.pose_noise or (0.0, 0.0)
    given = truth + np.random.default_rng(seed).standard_normal(truth.shape) * [place, place, heading]
    poses, driven = folder / "given.csv", None
    folder.mkdir(parents=True, exist_ok=True)
    _write_poses(poses, given)
    if case.odometry is not None:
        driven = folder / "odometry.csv"
        _write_poses(driven, _odometry(truth, case.odometry, np.random.default_rng([seed, 1])))
    most = MOST_SCANS if driven is None else MOST_FOLLOWED
    return Drive(log, poses, -(-len(truth) // most), truth, driven)


def recorded(folder: Path, log: Path) -> Drive:
    """Return the drive of the Intel lab: its own odometry, poses of a scan matcher, and those of the log as truth."""
    poses, odometry = (folder / f"intel-{name}.txt.gz" for name in ("Pose", "Odom"))
    return Drive(log, poses, 1, read_readings(str(log)).notes.scans.pose, odometry)


def _odometry(truth: Floats, kind: str, rng: np.random.Generator) -> Floats:
    """Return the way (n, 3) that wheels of a kind have a robot go from the first true pose."""
    motion = seen_from(truth[:-1], truth[1:])
    steps = motion + rng.standard_normal(motion.shape) * step_spread(motion, ODOMETRY[kind])
    steps[:, 2] += TURNING * np.abs(motion[:, 2])
    poses = [truth[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _write_poses(path: Path, poses: Floats) -> None:
    np.savetxt(path, poses, fmt="%.6f", delimiter=",", header="x,y,theta", comments="")
