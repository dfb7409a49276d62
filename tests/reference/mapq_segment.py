"""Slow twins of the segmentation's kernels, and the scenes that its tests look at."""

from __future__ import annotations

import numpy as np

from mapq.cloud import PointCloud


def nearest(xyz: np.ndarray, k: int, max_gap: float = np.inf) -> np.ndarray:
    """Return the k nearest others (n, k), ties by number, none beyond `max_gap`; -1 fills up."""
    d = xyz[:, None] - xyz[None]
    squared = d[..., 0] * d[..., 0] + d[..., 1] * d[..., 1] + d[..., 2] * d[..., 2]
    np.fill_diagonal(squared, np.inf)
    order = np.argsort(squared, axis=1, kind="stable")[:, :k]
    found = np.where(np.take_along_axis(squared, order, axis=1) <= min(max_gap * max_gap, 1e300), order, -1)
    return np.pad(found, ((0, 0), (0, max(k - len(xyz), 0))), constant_values=-1)


def plane_of(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal (3,) of the plane through points, up to its sign, and their variances (3,), ascending."""
    offset = xyz - xyz.mean(axis=0)
    variances, vectors = np.linalg.eigh(offset.T @ offset / len(xyz))
    return vectors[:, 0], variances


def wall(
    rng: np.random.Generator,
    length: float = 12.0,
    height: float = 5.0,
    spacing: float = 0.15,
    noise: float = 0.02,
    degrees: float = 0.0,
    offset: float = 0.0,
    start: float = 0.0,
) -> np.ndarray:
    """Return points at random on an upright wall through the origin, turned about it, then moved along y."""
    n = int(length * height / spacing**2)
    u, v = rng.uniform(-length / 2, length / 2, n) + start, rng.uniform(0.0, height, n)
    turn = np.radians(degrees)
    surface = np.column_stack([u * np.cos(turn), u * np.sin(turn) + offset, v])
    return surface + rng.normal(0.0, noise, (n, 3)) if noise else surface


def ground(rng: np.random.Generator, side: float = 14.0, spacing: float = 0.15, noise: float = 0.02) -> np.ndarray:
    """Return points at random on level ground."""
    n = int(side * side / spacing**2)
    flat = np.column_stack([rng.uniform(-side / 2, side / 2, (n, 2)), np.zeros(n)])
    return flat + rng.normal(0.0, noise, (n, 3)) if noise else flat


def scan_lines(along: float = 0.03, across: float = 0.3, noise: float = 0.02, seed: int = 0) -> np.ndarray:
    """Return a wall of 12 x 6 m that was scanned in level lines."""
    u, z = np.meshgrid(np.arange(-6.0, 6.0, along), np.arange(0.0, 6.0, across))
    xyz = np.column_stack([u.ravel(), np.zeros(u.size), z.ravel()])
    return xyz + np.random.default_rng(seed).normal(0.0, noise, xyz.shape)


def cloud_of(*parts: np.ndarray) -> tuple[PointCloud, np.ndarray]:
    """Return a cloud of several surfaces, and the number of the surface (n,) that each point is on."""
    truth = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return PointCloud.from_world(np.concatenate(parts)), truth
