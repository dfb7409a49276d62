"""Poses of a log with errors: their sizes are those of the prior that the sampler has."""

from __future__ import annotations

import numpy as np
import pytest

from prf.poses.model import ODOMETRY, PosePrior, step_spread
from prf.poses.plane import seen_from, wrapped
from prf.shell.errors import ConfigError
from prf.simulate import Scans, SimulateConfig, Spacing, scans_along
from prf.simulate.given import given_scans, rms_errors

CORNERS = np.array([[2.0, 2.0], [28.0, 2.0], [28.0, 18.0], [2.0, 18.0], [2.0, 2.0]])
SCANS = scans_along(CORNERS, Spacing())


def test_independent_errors_have_the_deviations_asked_for() -> None:
    found = np.array([rms_errors(SCANS, given(noise=(0.05, 0.01), seed=seed)) for seed in range(20)])
    assert np.sqrt((found**2).mean(axis=0)) == pytest.approx([0.05 * 2**0.5, 0.01], rel=0.05)
    assert np.array_equal(given(noise=(0.05, 0.01), seed=1).time, SCANS.time)


def test_steps_of_odometry_err_as_the_sampler_assumes_and_add_up() -> None:
    motion = seen_from(SCANS.pose[:-1], SCANS.pose[1:])
    spread = step_spread(motion, ODOMETRY["poor"])
    drawn = [given(odometry=ODOMETRY["poor"], seed=seed).pose for seed in range(50)]
    error = np.array([seen_from(pose[:-1], pose[1:]) - motion for pose in drawn])
    error[:, :, 2] = wrapped(error[:, :, 2])
    assert ((error / spread) ** 2).mean(axis=(0, 1)) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)
    assert all(np.array_equal(pose[0], SCANS.pose[0]) for pose in drawn)
    # The law of the true poses around the recorded ones is the sampler's prior.
    prior = PosePrior(drawn[0], np.full(2, np.inf), seen_from(drawn[0][:-1], drawn[0][1:]), spread)
    assert -2.0 * prior.log_density(SCANS.pose) == pytest.approx(motion.size, rel=0.25)


@pytest.mark.parametrize(("kind", "largest"), [("precise", 0.6), ("wheels", 3.0), ("poor", 15.0)])
def test_a_loop_misses_by_what_such_a_robot_misses(kind: str, largest: float) -> None:
    missed = [given(odometry=ODOMETRY[kind], seed=seed).pose[-1, :2] - SCANS.pose[-1, :2] for seed in range(50)]
    assert largest / 6.0 < np.sqrt((np.array(missed) ** 2).sum(axis=1).mean()) < largest


def test_errors_of_both_kinds_at_once_are_refused() -> None:
    with pytest.raises(ConfigError, match="--pose-noise or --odometry"):
        SimulateConfig(pose_noise=(0.1, 0.1), odometry_noise=ODOMETRY["wheels"])


def given(noise: tuple[float, float] | None = None, odometry: tuple[float, ...] | None = None, seed: int = 0) -> Scans:
    return given_scans(SCANS, noise, odometry, np.random.default_rng(seed))
