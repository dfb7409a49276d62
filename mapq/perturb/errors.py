"""Known errors of poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import PerturbSettings
from mapq.posed.scans import drive_passes, driven
from prf.shell.cli.storage import spawn_generators

Floats = NDArray[np.float64]

STANDING = 1.0
"""Metres: on a shorter way errors grow from scan to scan, not along it."""


def displaced(poses: Floats, errors: PerturbSettings, seed: int) -> Floats:
    """Return poses (k, 4, 4) with errors; the first scan stays where it is.

    Each kind of error draws from a generator of its own, so that one does not change the others.

    Parameters
    ----------
    poses : (k, 4, 4) float64
        ``T_map_scan`` in the order of time, z upwards.
    errors : PerturbSettings
        Its `offset`, `yaw`, `drift` and `missed_loop`; all are horizontal, and any may be combined.
    seed : int
    """
    in_drift, in_loop, in_offset, in_yaw = spawn_generators(seed, 4)
    moved = _drifted(poses, errors.drift, in_drift)
    moved = _with_missed_loop(moved, drive_passes(poses), errors.missed_loop, in_loop)
    for scan in range(1, len(poses)):
        moved[scan, :2, 3] += errors.offset * _direction(in_offset)
        moved[scan, :3, :3] = _about_z(errors.yaw * in_yaw.choice([-1.0, 1.0])) @ moved[scan, :3, :3]
    return moved


def first_revisit(passes: NDArray[np.int16]) -> int:
    """Return the first scan of the second pass, of passes (k,); the middle one where there is no second."""
    again = np.flatnonzero(passes > 0)
    return int(again[0]) if len(again) else (len(passes) + 1) // 2


def _drifted(poses: Floats, size: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Return the poses as odometry has them, whose errors grow evenly."""
    metres, degrees = size
    share = _share_of_way(poses)
    direction, sign = _direction(rng), rng.choice([-1.0, 1.0])
    turned = sign * degrees * share
    moved = poses.copy()
    steps = np.diff(poses[:, :3, 3], axis=0)
    middle = 0.5 * (turned[1:] + turned[:-1])
    along = np.array([_about_z(angle) @ step for angle, step in zip(middle, steps, strict=True)]).reshape(-1, 3)
    moved[1:, :3, 3] = poses[0, :3, 3] + np.cumsum(along, axis=0)
    moved[:, :2, 3] += metres * share[:, None] * direction
    for scan, angle in enumerate(turned):
        moved[scan, :3, :3] = _about_z(angle) @ poses[scan, :3, :3]
    return moved


def _with_missed_loop(
    poses: Floats, passes: NDArray[np.int16], size: tuple[float, float], rng: np.random.Generator
) -> Floats:
    """Return the poses with all from the first revisit on displaced together, turned about where it is."""
    metres, degrees = size
    direction, sign = _direction(rng), rng.choice([-1.0, 1.0])
    begin = first_revisit(passes)
    if begin >= len(poses):
        return poses
    motion = np.eye(4)
    motion[:3, :3] = _about_z(sign * degrees)
    pivot = poses[begin, :3, 3]
    motion[:3, 3] = pivot - motion[:3, :3] @ pivot
    motion[:2, 3] += metres * direction
    return np.concatenate([poses[:begin], motion @ poses[begin:]])


def _share_of_way(poses: Floats) -> Floats:
    """Return the share (k,) of the way at each scan; of the scans, where the sensor hardly moves."""
    way = driven(poses)
    return way / way[-1] if way[-1] > STANDING else np.linspace(0.0, 1.0, len(poses))


def _direction(rng: np.random.Generator) -> Floats:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _about_z(degrees: float) -> Floats:
    """Return the rotation (3, 3) about the vertical."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
