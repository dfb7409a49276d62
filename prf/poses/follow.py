"""Odometry corrected on the way: every scan is matched with what was seen just before it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from prf.poses.errors import MEDIAN
from prf.poses.graph import Relations, root_of
from prf.poses.match import MOST_PULL, fit, place_of, search
from prf.poses.model import PosePrior
from prf.poses.plane import Floats, compose, seen_from, wrapped
from prf.poses.scans import WallPoints
from prf.shell.cli.console import Report, report_nothing

BEFORE = 12  # states whose points make the place
MOST = 100  # points of a scan that are matched
REACH = 12.0  # metres from the sensor
LEAST = np.array([0.3, 0.3, 0.15])  # m, m, rad that are searched round the odometry's prediction: it may slip
SIGMAS = 3.0
LOOSE = 3.0  # times the spread of the odometry that scans are matched with, until it is known how far it errs
SURE = 0.5  # spreads of the odometry that a scan fixes a step to, so that its error shows
FEWEST, MOST_SCALE = 20, 10.0  # steps that show it, and times by which it may err more than it says
NEAREST = np.geomspace(0.4, 0.1, 8)  # metres to the nearest seen point, in rounds of refinement
STRAY = 0.05  # metres that points lie off the lines of others
DRIFT = np.array([0.02, 0.02, 0.004])  # m, m, rad that a step errs besides: what errs alike for all points


class Followed(NamedTuple):
    """Odometry, each step corrected by the scan at its end."""

    poses: Floats  # (n, 3)
    steps: Relations
    fits: Floats  # (n - 1,) how well each scan lies on what was seen just before, up to 1; nan where nothing was
    scale: Floats  # (2,) times by which places and turns of the odometry err more than it says, at least 1


def follow(scans: WallPoints, prior: PosePrior, report: Report = report_nothing) -> Followed:
    """Return the odometry as its scans correct it; the share of scans followed is reported."""
    near = scans.select(np.hypot(*scans.point.T) < REACH)
    order = np.argsort(near.owner, kind="stable")
    ends = np.cumsum(np.bincount(near.owner, minlength=scans.n_states))[:-1]
    parts = [near.select(own) for own in np.split(order, ends)]
    poses, n = prior.given.copy(), len(prior.motion)
    found, known, fits = prior.motion.copy(), np.zeros((n, 3, 3)), np.full(n, np.nan)
    held = np.eye(3) / np.square(LOOSE * prior.spread)[:, None]
    for state in range(1, n + 1):
        before, step = range(max(0, state - BEFORE), state), state - 1
        local = np.full((n + 1, 3), np.nan)
        local[before] = seen_from(poses[step], poses[before])
        world = [parts[k].at(local) for k in before]
        seen, normal = (np.concatenate(each) for each in zip(*world, strict=True))
        own = parts[state].point[:: 1 + len(parts[state].point) // MOST]
        if len(own) and len(seen):
            place = place_of(seen, local[np.concatenate([parts[k].owner for k in before]), :2], REACH)
            window = np.maximum(LEAST, SIGMAS * prior.spread[step])
            ways, _ = search(place, own, found[step], window, held[step])
            found[step], known[step], held[step] = _refined(ways[0][0], own, seen, normal, found[step], held[step])
            _, fits[step] = fit(place, own, found[step])
        poses[state] = compose(poses[step], found[step])
        report(state / n)
    return _fused(prior, found, known, held, fits)


def _fused(prior: PosePrior, found: Floats, known: Floats, held: Floats, fits: Floats) -> Followed:
    """Return what scans and odometry together say of each step.

    `found` (n - 1, 3): the steps by both, the odometry held by `held`; `known` (n - 1, 3, 3): information of the scans.
    """
    off = found - prior.motion
    off[:, 2] = wrapped(off[:, 2])
    # Steps by scans alone, less those of the odometry, times their information.
    pull = np.einsum("kij,kj->ki", known + held, off)
    sharp = np.diagonal(known, axis1=1, axis2=2) > 1.0 / np.square(SURE * prior.spread)
    z = np.abs(off / prior.spread)
    scale = np.array([_scale(z[:, columns][sharp[:, columns]]) for columns in ([0, 1], [2])])
    spread = prior.spread * scale[[0, 0, 1]]
    again = np.eye(3) / np.square(spread)[:, None]
    slipped = prior._replace(spread=spread).slipped(_along(prior, found))
    again *= (1.0 - slipped)[:, None, None]
    information = known + again
    steps = prior.motion + np.linalg.solve(information, pull[:, :, None])[:, :, 0]
    covariance = np.asarray(np.linalg.inv(information) + np.diag(DRIFT**2), np.float64)
    tail = np.arange(len(steps))
    return Followed(_along(prior, steps), Relations(tail, tail + 1, steps, root_of(covariance)), fits, scale)


def _along(prior: PosePrior, steps: Floats) -> Floats:
    """Return the poses (n, 3) that steps (n - 1, 3) lead to from the first given one."""
    poses = [prior.given[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _scale(z: Floats) -> float:
    """Return by how much more than they say errors vary, of their sizes (k,) in standard deviations; slips aside."""
    return float(np.clip(np.median(z) / MEDIAN, 1.0, MOST_SCALE)) if len(z) >= FEWEST else 1.0


def _refined(
    pose: Floats, own: Floats, seen: Floats, normal: Floats, about: Floats, information: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return a pose (3,) at which points lie on the lines through the nearest seen points, and the information of it.

    That of the points, and that of `about` as far as it held: the robot may have slipped. The iterated closest points
    of Chen and Medioni (1992).
    """
    tree, known, held = cKDTree(seen), np.zeros((3, 3)), information
    for nearest in NEAREST:
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        turned = own @ np.array([[cosine, sine], [-sine, cosine]])
        distance, at = tree.query(turned + pose[:2])
        kept = distance < nearest
        line, turned = normal[at[kept]], turned[kept]
        error = np.einsum("ij,ij->i", line, turned + pose[:2] - seen[at[kept]])
        lever = np.column_stack([line, line[:, 1] * turned[:, 0] - line[:, 0] * turned[:, 1]])
        weight = 1.0 / np.square(STRAY * (1.0 + np.square(error / nearest)))
        off = about - pose
        pull = 0.5 * float(off @ information @ off)
        held = information / (1.0 + math.exp(min(pull - MOST_PULL, MOST_PULL)))
        known = (weight[:, None] * lever).T @ lever
        pose = pose + np.linalg.solve(held + known, held @ off - lever.T @ (weight * error))
    return pose, known, held
