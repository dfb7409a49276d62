"""Odometry: where the robot believes to be, with errors of heading and of driven length that accumulate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.simulate.robot import STEP, Trajectory
from mapq.simulate.settings import Settings

Floats = NDArray[np.float64]

SMOOTH = 12.0
"""Metres over which the scale error keeps its value: slip comes with the ground, not with the instant."""


def odometry(truth: Trajectory, settings: Settings, rng: np.random.Generator) -> Trajectory:
    """Return the trajectory as odometry has it, which begins where the true one does.

    The heading error grows by a constant bias and a random walk, the driven length is wrong by a share that wanders
    slowly. Errors grow evenly along the way, so that what is seen within some metres of driving stays crisp; what is
    seen again a lap later has moved.
    """
    n_steps = len(truth.distance) - 1
    per_metre = np.radians(settings.drift * settings.yaw_bias) / 100.0
    bias = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.4) * per_metre
    walk = np.radians(settings.drift * settings.yaw_walk) * np.sqrt(STEP / 100.0)
    turned = np.concatenate([[0.0], np.cumsum(bias * STEP + walk * rng.standard_normal(n_steps))])
    scale = 1.0 + settings.drift * settings.scale_walk / 100.0 * _wandering(n_steps, rng)
    steps = np.diff(truth.xy, axis=0) * scale[:, None]
    middle = 0.5 * (turned[1:] + turned[:-1])
    c, s = np.cos(middle), np.sin(middle)
    moved = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], axis=1)
    xy = np.concatenate([truth.xy[:1], truth.xy[0] + np.cumsum(moved, axis=0)])
    return truth._replace(xy=xy, heading=truth.heading + turned)


def _wandering(n_steps: int, rng: np.random.Generator) -> Floats:
    """Return a stationary series (n_steps,) of variance 1 that forgets itself over `SMOOTH` metres."""
    knots = rng.standard_normal(int(n_steps * STEP / SMOOTH) + 2)
    # Between knots the variance falls to a half; the factor makes it 1 on average.
    between = np.interp(np.arange(n_steps) * STEP / SMOOTH, np.arange(len(knots)), knots)
    return np.asarray(between * np.sqrt(1.5))
