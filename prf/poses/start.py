"""Where chains of uncertain poses start: at poses at which the scans agree.

Given poses are aligned as they are. Odometry is first corrected on the way, then loops are closed.
"""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np

from prf.poses.align import align, disturbed
from prf.poses.errors import independence
from prf.poses.follow import follow
from prf.poses.graph import Pull, Relations, root_of
from prf.poses.loops import close_loops
from prf.poses.model import PoseModel, PosePrior
from prf.poses.pieces import LoopMatch
from prf.poses.plane import Floats
from prf.poses.scans import WallPoints, scans_of
from prf.readings import Readings

logger = logging.getLogger(__name__)

FAR = 5.0  # metres, a usual range: how far an error of the heading moves points
HELD = 1e6  # one over the standard deviation, m or rad, of the first pose where it fixes the frame
LEAST_HELD = 1e-10  # share of what holds a step that is left where it slipped
LEFT = 0.1  # metres that points lie apart once loops are closed, about
MOST_POINTS = 200_000  # more add little


class Start(NamedTuple):
    """Poses at which scans agree, what they are drawn round by, and where else the robot may have been."""

    poses: Floats  # (n, 3)
    scans: WallPoints
    pull: Pull
    loops: list[LoopMatch]  # of odometry: plausible closures, used or not
    independence: float = 1.0  # independent readings of the model that a beam is worth

    def draw(self, rng: np.random.Generator, sign: float = 1.0) -> Floats:
        """Return poses (n, 3), about a draw of their posterior, so that chains start apart; -1: the opposite one."""
        if not len(self.scans.owner):
            return self.poses.copy()
        found = disturbed(self.scans, self.poses, self.pull, rng, sign)
        is_held = self.pull.sharpness[0] >= HELD
        found[0, is_held] = self.poses[0, is_held]
        return found


def find_trajectory(model: PoseModel, laser: Readings, noise: float, rng: np.random.Generator | None = None) -> Floats:
    """Return poses at which scans agree, for a chain to start at.

    Parameters
    ----------
    model : PoseModel
        The uncertain poses; their given ones are returned where it has no laser.
    laser : Readings
        The readings that `model.laser` has the frames of, in the same order.
    noise : float
        Standard deviation of a range, metres.
    rng : numpy.random.Generator, optional
        Draws about from the posterior of the poses (:meth:`Start.draw`); without it the poses are its mode.

    Returns
    -------
    (n, 3) float64
        x, y in metres and heading in radians.
    """
    start = find_start(model, laser, noise)
    return start.poses if rng is None else start.draw(rng)


def find_start(model: PoseModel, laser: Readings, noise: float) -> Start:
    """Return poses at which scans agree, arguments as of :func:`find_trajectory`; always the same for the same."""
    prior, pull = model.prior, pull_of(model.prior)
    scans = scans_of(model, laser, noise)
    if not len(scans.owner):
        return Start(prior.given.copy(), scans, pull, [])
    poses, loops, error = prior.given, list[LoopMatch](), float(prior.noise[0] + FAR * prior.noise[1])
    if prior.is_held:
        followed = follow(scans, prior)
        poses, loops = close_loops(scans, followed, pull)
        pull = pull_of(prior, poses)
        n_used = sum(loop.is_used for loop in loops)
        logger.info(f"start trajectory: {n_used} closures of loops, {len(loops) - n_used} plausible ones left out")
        error = LEFT
    whole = scans
    scans = scans.select(np.arange(len(scans.owner)) % (1 + len(scans.owner) // MOST_POINTS) == 0)
    poses = align(scans, poses, pull, error, np.random.default_rng(0))
    share = independence(whole, poses)
    return Start(poses, scans._replace(weight=share * scans.weight), pull, loops, share)


def pull_of(prior: PosePrior, poses: Floats | None = None) -> Pull:
    """Return the density of the poses as errors in standard deviations; steps that slipped at `poses` hold nothing."""
    n, steps = len(prior.given), np.arange(len(prior.motion))
    sharpness = np.zeros((n, 3)) if prior.is_held else np.tile(1.0 / prior.noise[[0, 0, 1]], (n, 1))
    if prior.is_held:
        sharpness[0] = HELD
    root = root_of(np.square(prior.spread)[:, :, None] * np.eye(3))
    if poses is not None:
        root *= np.sqrt(np.maximum(1.0 - prior.slipped(poses), LEAST_HELD))[:, None, None]
    return Pull(prior.given, sharpness, Relations(steps, steps + 1, prior.motion, root))
