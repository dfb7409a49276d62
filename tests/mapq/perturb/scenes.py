"""Walls scanned from known places, for tests of labels: what a scan sees is what faces its sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mapq.cloud import PointCloud
from mapq.posed import PosedScans
from tests.mapq.factories import Rectangle


def pose_at(x: float, y: float, degrees: float = 0.0, z: float = 1.5) -> np.ndarray:
    """Return the pose (4, 4) of a sensor that stands upright."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0, x], [s, c, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def make_scans(
    points: Sequence[np.ndarray], poses: Sequence[np.ndarray], times: np.ndarray | None = None
) -> PosedScans:
    """Return scans of points (n, 3) that each scan sees in the world, taken from poses."""
    clouds = []
    for seen, pose in zip(points, poses, strict=True):
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        clouds.append(PointCloud.from_world(local, {"intensity": np.arange(len(seen), dtype=np.float32)}, "made"))
    names = tuple(f"scan {number}" for number in range(len(clouds)))
    return PosedScans(names, np.array(poses), times, clouds.__getitem__, np.arange(len(clouds)), "made")


def look(walls: Sequence[Rectangle], pose: np.ndarray, seed: int, density: float = 60.0, noise: float = 0.005):
    """Return the points (n, 3) of walls as one scan sees them: each wall anew, whichever way it faces."""
    rng = np.random.default_rng(seed)
    return np.concatenate([wall.sample(rng, density, noise) for wall in walls])


def rings(wall: Rectangle, foot: float, apart: float, seed: int) -> np.ndarray:
    """Return points (n, 3) on level lines of a wall, 5 cm apart along it, the lowest `foot` above its foot."""
    along = np.arange(-0.5 * wall.width, 0.5 * wall.width, 0.05)
    heights = np.arange(-0.5 * wall.height + foot, 0.5 * wall.height, apart)
    places = np.array([(x, z, 0.0) for z in heights for x in along])
    places[:, 2] = np.random.default_rng(seed).normal(0.0, 0.005, len(places))
    return np.array(wall.middle) + places @ wall.axes


COURT = [
    Rectangle((10.0, 0.0, 2.0), (1, 0, 0), width=20.0),
    Rectangle((10.0, 14.0, 2.0), (1, 0, 0), width=20.0),
    Rectangle((0.0, 7.0, 2.0), (0, 1, 0), width=14.0),
    Rectangle((20.0, 7.0, 2.0), (0, 1, 0), width=14.0),
    Rectangle((10.0, 7.0, 0.0), (1, 0, 0), (0, 1, 0), width=20.0, height=14.0),
]
"""Four walls round a yard of 20 x 14 m, and its ground."""
