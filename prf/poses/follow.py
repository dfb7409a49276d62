"""Odometry corrected on the way: every scan is matched with what was seen just before it."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from prf.poses.graph import Relations, root_of
from prf.poses.match import place_of, search
from prf.poses.model import PosePrior
from prf.poses.plane import Floats, compose, seen_from
from prf.poses.scans import WallPoints

BEFORE = 12  # states whose points make the place
MOST = 100  # points of a scan that are matched
REACH = 12.0  # metres from the sensor
LEAST = np.array([0.1, 0.1, 0.04])  # m, m, rad that are searched round the odometry's prediction
SIGMAS = 3.0
NEAREST = np.geomspace(0.4, 0.1, 8)  # metres to the nearest seen point, in rounds of refinement
STRAY = 0.05  # metres that points lie off the lines of others
DRIFT = np.array([0.02, 0.02, 0.004])  # m, m, rad that a step errs besides: what errs alike for all points


def follow(scans: WallPoints, prior: PosePrior) -> tuple[Floats, Relations]:
    """Return the poses (n, 3) of odometry, each corrected by the scan, and the steps from each to the next."""
    near = scans.select(np.hypot(*scans.point.T) < REACH)
    order = np.argsort(near.owner, kind="stable")
    ends = np.cumsum(np.bincount(near.owner, minlength=scans.n_states))[:-1]
    parts = [near.select(own) for own in np.split(order, ends)]
    poses = prior.given.copy()
    known = np.zeros((len(poses) - 1, 3, 3))
    for state in range(1, len(poses)):
        before = range(max(0, state - BEFORE), state)
        local = np.full((len(poses), 3), np.nan)
        local[before] = seen_from(poses[state - 1], poses[before])
        world = [parts[k].at(local) for k in before]
        seen, normal = (np.concatenate(each) for each in zip(*world, strict=True))
        own = parts[state].point[:: 1 + len(parts[state].point) // MOST]
        about, information = prior.motion[state - 1], np.diag(1.0 / prior.spread[state - 1] ** 2)
        if len(own) and len(seen):
            place = place_of(seen, local[np.concatenate([parts[k].owner for k in before]), :2], REACH)
            window = np.maximum(LEAST, SIGMAS * prior.spread[state - 1])
            ways, _ = search(place, own, about, window, information)
            about, information = _refined(ways[0][0], own, seen, normal, about, information)
        poses[state] = compose(poses[state - 1], about)
        known[state - 1] = information
    tail = np.arange(len(poses) - 1)
    covariance = np.asarray(np.linalg.inv(known) + np.diag(DRIFT**2), np.float64)
    return poses, Relations(tail, tail + 1, seen_from(poses[:-1], poses[1:]), root_of(covariance))


def _refined(
    pose: Floats, own: Floats, seen: Floats, normal: Floats, about: Floats, information: Floats
) -> tuple[Floats, Floats]:
    """Return a pose (3,) at which points lie on the lines through the nearest seen points, and its information.

    The iterated closest points of Chen and Medioni (1992).
    """
    tree, matrix = cKDTree(seen), information
    for nearest in NEAREST:
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        turned = own @ np.array([[cosine, sine], [-sine, cosine]])
        distance, at = tree.query(turned + pose[:2])
        kept = distance < nearest
        line, turned = normal[at[kept]], turned[kept]
        error = np.einsum("ij,ij->i", line, turned + pose[:2] - seen[at[kept]])
        lever = np.column_stack([line, line[:, 1] * turned[:, 0] - line[:, 0] * turned[:, 1]])
        weight = 1.0 / np.square(STRAY * (1.0 + np.square(error / nearest)))
        matrix = information + (weight[:, None] * lever).T @ lever
        pose = pose + np.linalg.solve(matrix, information @ (about - pose) - lever.T @ (weight * error))
    return pose, matrix
