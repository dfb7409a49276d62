"""Where chains of uncertain poses start: at poses at which the scans agree."""

from __future__ import annotations

import numpy as np

from prf.logs import Readings
from prf.poses.align import align, dispersed
from prf.poses.graph import Pull, Relations
from prf.poses.model import PoseModel, PosePrior
from prf.poses.plane import Floats
from prf.poses.scans import scans_of

FAR = 5.0  # metres, a usual range: how far an error of the heading moves points
HELD = 1e6  # one over the standard deviation, m or rad, of the first pose where it fixes the frame
MOST_POINTS = 150_000  # more say little more


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
        Draws from the normal approximation of the posterior of the poses, so that chains start apart; without it the
        poses are its mode, and always the same.

    Returns
    -------
    (n, 3) float64
        x, y in metres and heading in radians.
    """
    if model.laser is None:
        return model.prior.given.copy()
    random = np.random.default_rng(0) if rng is None else rng
    scans, prior = scans_of(model, laser, noise), model.prior
    scans = scans.select(np.arange(len(scans.owner)) % (1 + len(scans.owner) // MOST_POINTS) == 0)
    pull = pull_of(prior)
    error = float(prior.noise[0] + FAR * prior.noise[1])
    poses = align(scans, prior.given, pull, error, random)
    return poses if rng is None else dispersed(scans, poses, pull, rng)


def pull_of(prior: PosePrior) -> Pull:
    """Return the density of the poses as errors in standard deviations."""
    n, k = len(prior.given), len(prior.motion)
    sharpness = np.zeros((n, 3)) if prior.is_held else np.tile(1.0 / prior.noise[[0, 0, 1]], (n, 1))
    if prior.is_held:
        sharpness[0] = HELD
    root = np.zeros((k, 3, 3))
    root[:, [0, 1, 2], [0, 1, 2]] = 1.0 / prior.spread
    steps = np.arange(k, dtype=np.int64)
    return Pull(prior.given, sharpness, Relations(steps, steps + 1, prior.motion, root))
