"""Poses as a log has them where the robot does not know its own: true ones with errors, or odometry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from prf.poses.model import PosePrior, step_spread
from prf.poses.plane import Floats, seen_from, wrapped
from prf.simulate.path import Scans

NO_STEPS = np.zeros((0, 3))
UNKNOWN = (np.inf, np.inf)


def given_scans(
    scans: Scans, noise: Sequence[float] | None, odometry: Sequence[float] | None, rng: np.random.Generator
) -> Scans:
    """Return scans at the poses that a robot would write down, drawn from the model that `prf sample` assumes.

    `noise`: standard deviations of independent errors, metres and radians. `odometry`: the four numbers of
    :data:`prf.configuration.ODOMETRY`; steps from scan to scan, each with its error, add up from the true first pose.
    """
    steps = (NO_STEPS, NO_STEPS)
    if odometry is not None:
        motion = seen_from(scans.pose[:-1], scans.pose[1:])
        steps = (motion, step_spread(motion, odometry))
    prior = PosePrior(scans.pose, np.array(UNKNOWN if noise is None else noise, np.float64), *steps)
    return Scans.rounded(prior.draw(rng), scans.time)


def rms_errors(scans: Scans, given: Scans) -> list[float]:
    """Return the root mean square errors of given poses: of the place, metres, and of the heading, radians."""
    error: Floats = given.pose - scans.pose
    squares = (error[:, 0] ** 2 + error[:, 1] ** 2, wrapped(error[:, 2]) ** 2)
    return [float(np.sqrt(each.mean())) for each in squares]
