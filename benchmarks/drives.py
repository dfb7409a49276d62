"""Drives whose truth is known and whose poses err: simulated floors and loops, and public logs with errors added."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.commands import made
from prf.readings import read_readings

Floats = NDArray[np.float64]

TUNING, JUDGING = (1, 2, 3), (11, 12, 13, 14, 15)
REAL = {TUNING: ("intel",), JUDGING: ("freiburg-101", "aces", "csail")}
MOST_SCANS = 300  # of a public log, evenly; more take longer and say no more
SIZE = [20.0, 14.0]  # metres, of an office


class Case(NamedTuple):
    """What the poses of a drive err by, as options have it."""

    pose_noise: list[float] | None = None
    odometry: str | None = None


CASES = {
    "small": Case([0.05, 0.01]),
    "large": Case([0.15, 0.03]),
    "loop": Case(odometry="wheels"),
    "real": Case([0.15, 0.03]),
}


class Drive(NamedTuple):
    """A log whose poses err, and the truth."""

    log: Path
    poses: Path | None  # those that err, where they are not the log's own
    every_scan: int
    truth: Floats  # (n_scans, 3) of all scans of the log


def loop_world(folder: Path, seed: int) -> tuple[Path, Path]:
    """Write a ring of corridors with niches and pillars, and waypoints once round it and a bit; return both files."""
    rng = np.random.default_rng(seed)
    wide, high, across = rng.uniform(24.0, 32.0), rng.uniform(14.0, 22.0), rng.uniform(2.2, 3.0)
    low = 0.5 * across
    free = [shapely.box(0, 0, wide, high).difference(shapely.box(across, across, wide - across, high - across))]
    way = shapely.LinearRing([(low, low), (wide - low, low), (wide - low, high - low), (low, high - low)])
    pillars = []
    for along in np.arange(3.0, way.length, 4.0):  # 4 m apart, so that none touch
        (x, y), half = way.interpolate(along + rng.uniform(-0.5, 0.5)).coords[0], rng.uniform(0.4, 1.2)
        left, right = low + rng.uniform(0.2, 1.2, 2)  # how far niches reach from the middle of the corridor
        is_upright = low < y < high - low
        reach = (left, half, right, half) if is_upright else (half, left, half, right)
        free.append(shapely.box(x - reach[0], y - reach[1], x + reach[2], y + reach[3]))
        aside = rng.choice([-1.0, 1.0], 2) * (low - 0.35)
        pillar = shapely.Point(x + aside[0], y + aside[1])
        if pillar.distance(way) > 0.45:
            pillars.append(pillar.buffer(rng.uniform(0.1, 0.2), quad_segs=2))
    walls = shapely.box(-3, -3, wide + 3, high + 3).difference(shapely.union_all(free))
    world, path = folder / "world.geojson", folder / "way.csv"
    folder.mkdir(parents=True, exist_ok=True)
    world.write_text(shapely.to_geojson(shapely.union_all([walls, *pillars])))
    stops = [*way.coords, way.interpolate(8.0).coords[0]]
    path.write_text("x,y\n" + "".join(f"{x:.4f},{y:.4f}\n" for x, y in stops))
    return world, path


def simulated(folder: Path, name: str, seed: int) -> Drive:
    """Simulate a drive whose log has poses with errors."""
    case, output = CASES[name], folder / "drive"
    if name == "loop":
        world, path = loop_world(folder, seed)
        made("simulate", output, world=world, path=path, odometry=case.odometry, seed=seed)
    else:
        made("simulate", output, size=SIZE, pose_noise=case.pose_noise, seed=seed)
    truth = np.loadtxt(output / "true_poses.csv", delimiter=",", skiprows=1)[:, 1:]
    return Drive(output / "laser.log.gz", None, 1, truth)


def disturbed(folder: Path, log: Path, noise: list[float], seed: int) -> Drive:
    """Write poses of a log with errors added, one for each scan; the log's own are the truth."""
    truth = read_readings(str(log)).notes.scans.pose
    given = truth + np.random.default_rng(seed).standard_normal(truth.shape) * [noise[0], *noise]
    file = folder / "given.csv"
    folder.mkdir(parents=True, exist_ok=True)
    np.savetxt(file, given, fmt="%.6f", delimiter=",", header="x,y,theta", comments="")
    return Drive(log, file, -(-len(truth) // MOST_SCANS), truth)
