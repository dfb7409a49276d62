"""What the scans show of the errors of ranges: how far beams of one scan lie off walls that others drew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from prf.poses.plane import Floats
from prf.poses.scans import WallPoints

MEDIAN = 0.6744897501960817  # of the size of a normal error, in standard deviations
MOST = 20_000  # points that are compared
OTHERS, FEWEST = 64, 8  # points of other scans that a wall is fitted to
REACH = 0.12  # metres from a point within which these lie
THIN = 3.0  # standard deviations that they lie off their line at most, or it is no wall
LAGS = 24  # beams up to which errors of one wall are compared
OFF_WALL = 4.0  # standard deviations from it beyond which a point says nothing of noise
UPRIGHT = 0.6  # cosine of the angle to the normal above which a distance from a wall says what a range errs by
LEAST_WORTH, MOST_WORTH = 0.02, 9.0  # readings that a beam may be worth
RIDGE = 1e-6  # added to normal equations, so that they have a solution
FEWEST_PAIRS = 100  # of points that a correlation is of, at least


def independence(scans: WallPoints, poses: Floats) -> float:
    """Return how many independent readings of the model a beam is worth, at poses (n, 3) at which the scans agree.

    Beams err by v times the variance of the model, with correlations r_k of those k beams apart on one wall: a beam
    is worth 1 / (v (1 + 2 sum r_k)), so that a wall is known as well as its points show. The sum has Bartlett's weights
    and ends where r_k is not above 0: poses took up what beams far apart have in common. 1 where scans show too little.
    """
    error = _errors(scans, poses)
    near = np.isfinite(error)
    if near.sum() < FEWEST_PAIRS:
        return 1.0
    near &= np.abs(error) < OFF_WALL * max(float(np.median(np.abs(error[near]))) / MEDIAN, 1e-9)
    variance, total, owner = float(np.mean(np.square(error[near]))), 1.0, scans.owner[: len(error)]
    for lag in range(1, min(LAGS, len(error) - 1) + 1):
        pair = (owner[:-lag] == owner[lag:]) & near[:-lag] & near[lag:]
        related = float((error[:-lag] * error[lag:])[pair].mean()) / variance if pair.sum() >= FEWEST_PAIRS else 0.0
        if related <= 0.0:
            break
        total += 2.0 * (1.0 - lag / (LAGS + 1.0)) * related
    return float(np.clip(1.0 / max(variance * total, 1e-9), LEAST_WORTH, MOST_WORTH))


def _errors(scans: WallPoints, poses: Floats) -> Floats:
    """Return by how many standard deviations the ranges of the first points err (m,), nan where no wall is there.

    A wall is what points of other scans near by lie on, so that a point has no part in what it is compared with.
    """
    world, facing = scans.at(poses)
    owner, own, sharpness = scans.owner[:MOST], world[:MOST], scans.weight[:MOST]
    distance, near = cKDTree(world).query(own, k=min(OTHERS, len(world)), distance_upper_bound=REACH)
    near = np.minimum(near, len(world) - 1)
    others = np.isfinite(distance) & (scans.owner[near] != owner[:, None])
    # Not the other side of a wall.
    others &= np.einsum("mki,mi->mk", facing[near], facing[:MOST]) > 0.0
    n = others.sum(axis=1)
    weight = others / np.maximum(n, 1)[:, None]
    around = world[near]
    middle = np.einsum("mk,mki->mi", weight, around)
    value, vector = np.linalg.eigh(
        np.einsum("mk,mki,mkj->mij", weight, around - middle[:, None], around - middle[:, None])
    )
    normal, seen = vector[:, :, 0], own - poses[owner, :2]
    upright = np.abs(np.einsum("mi,mi->m", normal, seen)) / np.maximum(np.linalg.norm(seen, axis=1), 1e-9)
    off = np.einsum("mi,mi->m", normal, own - middle) / np.maximum(upright, UPRIGHT) * np.sqrt(sharpness)
    is_wall = (n >= FEWEST) & (value[:, 0] * sharpness < THIN**2) & (upright > UPRIGHT)
    # The middle of n points errs too.
    off = np.where(is_wall, off / np.sqrt(1.0 + 1.0 / np.maximum(n, 1)), np.nan)
    lever = np.column_stack([normal, seen[:, 0] * normal[:, 1] - seen[:, 1] * normal[:, 0]])
    scale = np.sqrt(sharpness) / np.maximum(upright, UPRIGHT)
    return _without_pose(off, scale[:, None] * lever, owner)


def _without_pose(error: Floats, lever: Floats, owner: NDArray[np.int64]) -> Floats:
    """Return errors (m,) less what small changes of the poses of their scans, by levers (m, 3), would do away with."""
    known, n = np.isfinite(error), int(owner.max(initial=-1)) + 1
    value, by, of = np.where(known, error, 0.0), np.where(known[:, None], lever, 0.0), np.zeros((n, 3, 3))
    np.add.at(of, owner, by[:, :, None] * by[:, None, :])
    right = np.column_stack([np.bincount(owner, column * value, n) for column in by.T])
    change = np.linalg.solve(of + RIDGE * np.eye(3), right[:, :, None])[:, :, 0]
    return np.asarray(error - np.einsum("mi,mi->m", lever, change[owner]))
