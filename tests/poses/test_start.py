"""Where chains of uncertain poses start."""

from __future__ import annotations

import numpy as np
import pytest

from prf.configuration import load_configuration
from prf.poses.model import ODOMETRY, pose_model
from prf.poses.plane import seen_from
from prf.poses.start import find_start, find_trajectory
from prf.sampler.prepare import prepare
from tests.poses.drives import BLOCK, ROOM, odometry_of, off, readings_at, round_the_block

ROUND = np.linspace(0.0, 2.0 * np.pi, 40)
TRUTH = np.column_stack([4.2 + 2.6 * np.cos(ROUND), 2.6 + 1.9 * np.sin(ROUND), ROUND + np.pi / 2])


@pytest.mark.parametrize("noise", [(0.05, 0.01), (0.15, 0.03)])
def test_disturbed_poses_of_a_room_are_found_again(noise):
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [noise[0], *noise]
    readings = readings_at(ROOM, TRUTH, given)
    model = pose_model(readings, None, noise)
    found = find_trajectory(model, readings, 0.03)
    assert off(found, TRUTH) < off(given, TRUTH) / 3.0
    np.testing.assert_array_equal(found, find_trajectory(model, readings, 0.03))
    drawn = [find_trajectory(model, readings, 0.03, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert 0.002 < off(drawn[0], drawn[2]) < 0.1


def test_a_loop_of_odometry_is_closed():
    truth = round_the_block()
    prior = odometry_of(truth, "poor")
    readings = readings_at(BLOCK, truth, prior.draw(np.random.default_rng(4)))
    model = pose_model(readings, None, None, ODOMETRY["poor"])
    assert off(model.prior.given, truth) > 1.0
    start = find_start(model, readings, 0.03)
    assert off(start.poses, truth) < 0.1
    np.testing.assert_allclose(start.poses[0], model.prior.given[0], atol=1e-6)
    used = [loop for loop in start.loops if loop.is_used]
    errors = [seen_from(truth[loop.tail], truth[loop.head])[:2] - loop.pose[:2] for loop in used]
    assert len(used) > 3
    assert np.median(np.hypot(*np.transpose(errors))) < 0.1


def test_chains_start_as_all_readings_have_it_however_few_are_used():
    noise = (0.15, 0.03)
    given = TRUTH + np.random.default_rng(3).normal(size=TRUTH.shape) * [noise[0], *noise]
    config = load_configuration({"pose_noise": noise, "assignments": ["thinning.beam_density=4.0"]}).settings
    settings = prepare(config, readings_at(ROOM, TRUTH, given)).settings
    assert settings.laser.readings.n_beams < 15 * len(TRUTH)
    model = settings.poses
    drawn = [model.draw_start(np.random.default_rng(seed)) for seed in (1, 2)]
    assert max(off(poses, TRUTH[model.scan]) for poses in drawn) < off(given, TRUTH) / 3.0
    assert off(*drawn) > 0.002


def test_the_pose_that_fixes_the_frame_is_the_same_for_all_chains():
    truth = round_the_block()[:12]
    prior = odometry_of(truth, "wheels")
    model = pose_model(readings_at(BLOCK, truth, prior.given), None, None, ODOMETRY["wheels"])
    start = find_start(model, readings_at(BLOCK, truth, prior.given), 0.03)
    one, other = (start.draw(np.random.default_rng(seed)) for seed in (1, 2))
    np.testing.assert_array_equal(one[0], other[0])
    assert (one[1:] != other[1:]).all()
