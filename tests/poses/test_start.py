"""Where chains of uncertain poses start."""

from __future__ import annotations

import numpy as np
import pytest

from prf.poses.model import pose_model
from prf.poses.start import find_trajectory
from tests.poses.drives import ROOM, off, readings_at

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
