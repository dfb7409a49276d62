"""Patches made by hand: rectangles sampled with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.features.context import NODE_COLUMNS
from mapq.features.table import PatchFeatures
from mapq.labels import NO_PATCH
from mapq.patches import Patches

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Rectangle:
    """A rectangle in space: its middle, its in-plane axes (made orthonormal) and its lengths along them, in metres."""

    middle: tuple[float, float, float]
    across: tuple[float, float, float]
    along: tuple[float, float, float] = (0.0, 0.0, 1.0)
    width: float = 10.0
    height: float = 4.0

    @property
    def axes(self) -> Floats:
        """Return across, along and the normal as rows."""
        across = np.array(self.across) / np.linalg.norm(self.across)
        along = np.array(self.along) - (across @ np.array(self.along)) * across
        along /= np.linalg.norm(along)
        return np.stack([across, along, np.cross(across, along)])

    def sample(self, rng: np.random.Generator, density: float = 60.0, noise: float = 0.02) -> Floats:
        """Return points (n, 3) at `density` points a m², moved along the normal."""
        n = max(int(self.width * self.height * density), 3)
        places = np.column_stack(
            [
                rng.uniform(-0.5 * self.width, 0.5 * self.width, n),
                rng.uniform(-0.5 * self.height, 0.5 * self.height, n),
                rng.normal(0.0, noise, n) if noise else np.zeros(n),
            ]
        )
        return np.array(self.middle) + places @ self.axes


def wall(start: tuple[float, float], end: tuple[float, float], height: float = 4.0, foot: float = 0.0) -> Rectangle:
    """Return the upright rectangle over a line from `start` to `end` of the plan."""
    (x0, y0), (x1, y1) = start, end
    length = float(np.hypot(x1 - x0, y1 - y0))
    return Rectangle(
        (0.5 * (x0 + x1), 0.5 * (y0 + y1), foot + 0.5 * height), (x1 - x0, y1 - y0, 0.0), (0, 0, 1), length, height
    )


def make_patches(points: Sequence[Floats], normals: Sequence[Sequence[float]] | Floats, loose: int = 0) -> Patches:
    """Return patches of the given points, `loose` points without a patch behind them."""
    every = [np.asarray(one, np.float64).reshape(-1, 3) for one in points]
    patch = np.repeat(np.arange(len(every), dtype=np.int32), [len(one) for one in every])
    xyz = np.concatenate([*every, np.full((loose, 3), 50.0)]) if every or loose else np.zeros((0, 3))
    patch = np.concatenate([patch, np.full(loose, NO_PATCH, np.int32)])
    centroid = np.array([one.mean(axis=0) for one in every]).reshape(-1, 3)
    normal = np.array(normals, np.float64).reshape(-1, 3)
    return Patches.unlabelled(PointCloud(xyz, np.zeros(3)), patch, normal, centroid, {}, {})


def sample_patches(
    rectangles: Sequence[Rectangle], seed: int = 0, density: float = 60.0, noise: float = 0.02
) -> Patches:
    """Return the patches of sampled rectangles; each gets its own random numbers, so that one more changes none."""
    streams = np.random.SeedSequence(seed).spawn(len(rectangles))
    points = [one.sample(np.random.default_rng(s), density, noise) for one, s in zip(rectangles, streams, strict=True)]
    return make_patches(points, [one.axes[2] for one in rectangles])


def shuffled(patches: Patches, seed: int = 0) -> Patches:
    """Return the patches with their points in another order."""
    order = np.random.default_rng(seed).permutation(len(patches.cloud))
    return replace(patches, cloud=patches.cloud.take(order), patch=patches.patch[order])


def moved(patches: Patches, rotation: Floats, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> Patches:
    """Return the patches turned by `rotation` (3, 3), then shifted."""
    cloud = replace(patches.cloud, xyz=patches.cloud.xyz @ rotation.T + np.array(shift))
    centroid = patches.centroid @ rotation.T + np.array(shift)
    return replace(patches, cloud=cloud, normal=patches.normal @ rotation.T, centroid=centroid)


def turn(degrees: float) -> Floats:
    """Return the rotation about z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def always_known(features: PatchFeatures) -> Floats:
    """Return the node features (m, k) that no map leaves unknown: not those of scans and of copies."""
    unknown = {*NODE_COLUMNS["moments"], *NODE_COLUMNS["copies"]}
    return features.node[:, [name not in unknown for name in features.node_names]]
