"""Poses of a run that is let go of: fixed to one another at their means, they move as one body.

What readings say of poses they say of poses beside each other: map and poses explain them as well moved and turned as
a whole. So of that motion only the errors of the given poses tell. Where the places x_i have precisions w_i, and the
headings v_i, it is normal: a shift of precision sum w_i, and a turn about the mean c of x_i, weighed by w_i, of
precision sum v_i + w_i |x_i - c|^2.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from prf.poses.model import PosePrior
from prf.poses.posterior import Trajectory

BODY = -1
"""In place of the number of a scan: the pose is that of a body."""
NO_STEPS = np.zeros((0, 3))


def body_of(found: Trajectory) -> Trajectory:
    """Return the one pose of the body that all poses of a run make up, with its draws: its place is their centre."""
    whole = joined(found)
    assert whole.prior is not None
    place, turn = (1.0 / whole.prior.noise**2).T
    total = place.sum()
    centre = place @ whole.given[:, :2] / total
    off = whole.given[:, :2] - centre
    stiffness = turn.sum() + place @ (off**2).sum(axis=1)
    error = whole.draws.astype(np.float64)
    shift = np.einsum("n,dni->di", place, error[:, :, :2]) / total
    across = off[:, 0] * error[:, :, 1] - off[:, 1] * error[:, :, 0]
    turned = (error[:, :, 2] @ turn + across @ place) / stiffness
    given = np.array([[*centre, 0.0]])
    prior = PosePrior(given, 1.0 / np.sqrt([[total, stiffness]]), NO_STEPS, NO_STEPS, whole.prior.slip)
    draws = np.column_stack([shift, turned])[:, None].astype(np.float32)
    return Trajectory(np.array([BODY]), np.array([np.nan]), given, draws, chain=found.chain, prior=prior)


def joined(found: Trajectory) -> Trajectory:
    """Return all poses as one trajectory, that of the body first if there is one. None may be of odometry."""
    body, prior = found.body, found.prior
    if body is None or body.prior is None or prior is None:
        return found
    given = np.concatenate([body.given, found.given])
    return Trajectory(
        np.concatenate([body.scan, found.scan]),
        np.concatenate([body.time, found.time]),
        given,
        np.concatenate([body.draws, found.draws], axis=1),
        None if found.laser is None else found.laser + np.int32(1),
        None if found.sonar is None else found.sonar + np.int32(1),
        found.chain,
        prior._replace(given=given, noise=np.concatenate([body.prior.noise, prior.noise])),
    )


def apart(found: Trajectory) -> Trajectory:
    """Return the trajectory whose :func:`joined` this is: the first pose is a body's if its scan says so."""
    prior = found.prior
    if prior is None or found.scan[0] != BODY:
        return found
    body, rest = (
        dataclasses.replace(
            found,
            scan=found.scan[rows],
            time=found.time[rows],
            given=found.given[rows],
            draws=found.draws[:, rows],
            prior=prior._replace(given=found.given[rows], noise=prior.noise[rows]),
        )
        for rows in (slice(0, 1), slice(1, None))
    )
    laser, sonar = (None if owner is None else owner - np.int32(1) for owner in (found.laser, found.sonar))
    body = dataclasses.replace(body, laser=None, sonar=None)
    return dataclasses.replace(rest, laser=laser, sonar=sonar, body=body)
