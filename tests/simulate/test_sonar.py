"""The simulated ring of sonars: what echoes, from where, and what is in the way."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from prf.shell.errors import ConfigError
from prf.simulate.sonar import SonarPhysics, directivity_db, simulate_sonar

QUIET = SonarPhysics(
    flutter_db=0.0, noise=0.0, noise_relative=0.0, outlier_probability=0.0, miss_probability=0.0, edge_db=-90.0
)
AHEAD = np.zeros((1, 3))
ROOM = np.array([[-2.0, -1.0, 4.0, -1.0], [4.0, -1.0, 4.0, 3.0], [4.0, 3.0, -2.0, 3.0], [-2.0, 3.0, -2.0, -1.0]])
"""Walls round a room of 6 x 4 m, the free side on the left."""
BLOCK = np.array([[1.0, 0.2, 1.0, -0.2], [1.0, -0.2, 0.8, -0.2], [0.8, -0.2, 0.8, 0.2], [0.8, 0.2, 1.0, 0.2]])
"""Walls round a block of 0.2 x 0.4 m in it."""


def heard(walls: np.ndarray, heading: float, physics: SonarPhysics = QUIET) -> float:
    pose = np.array([[0.0, 0.0, heading]])
    return float(simulate_sonar(walls, pose, physics, np.random.default_rng(1), AHEAD)[0, 0])


def test_a_wall_echoes_from_the_foot_of_the_perpendicular_within_the_beam() -> None:
    assert heard(ROOM, 0.0) == 4.0
    assert heard(ROOM, math.radians(8.0)) == 4.0
    assert heard(ROOM, math.pi) == 2.0
    wall = ROOM[1:2]
    assert heard(wall, math.radians(13.6)) == math.inf
    assert heard(wall, math.pi) == math.inf


def test_a_square_corner_echoes_and_its_slanting_walls_do_not() -> None:
    corner = math.atan2(3.0, 4.0)
    assert heard(ROOM, corner) == pytest.approx(5.0)
    assert heard(ROOM[[0, 2, 3]], corner) == math.inf


def test_edges_that_stick_out_echo_weakly() -> None:
    diamond = np.array([[2.0, 0.0, 3.0, 1.0], [3.0, 1.0, 4.0, 0.0], [4.0, 0.0, 3.0, -1.0], [3.0, -1.0, 2.0, 0.0]])
    loud = dataclasses.replace(QUIET, edge_db=12.0)
    assert heard(diamond, 0.0, loud) == 2.0
    assert heard(diamond, math.radians(9.0), loud) == math.inf
    assert heard(diamond, 0.0) == math.inf


def test_nothing_behind_a_wall_is_heard() -> None:
    assert heard(np.concatenate([ROOM, BLOCK]), 0.0) == pytest.approx(0.8)
    assert heard(np.concatenate([ROOM, BLOCK + np.tile([0.0, 0.5], 2)]), 0.0) == 4.0
    assert heard(np.concatenate([ROOM, BLOCK - np.tile([2.0, 0.0], 2)]), 0.0) == 4.0
    screen = np.array([[1.0, -0.3, 3.0, 0.5]])
    assert heard(np.concatenate([ROOM[1:2], screen]), 0.0) == math.inf


def test_the_beam_has_its_first_zero_where_a_piston_has() -> None:
    zero = math.asin(3.8317 / (2.0 * math.pi * 49.4e3 / 343.0 * 0.018))
    assert directivity_db(np.array([0.0]), QUIET)[0] == pytest.approx(0.0)
    assert directivity_db(np.array([zero]), QUIET)[0] < -100.0
    assert directivity_db(np.array([3.0]), QUIET)[0] == -math.inf


def test_noise_outliers_and_misses_have_their_shares() -> None:
    noisy = dataclasses.replace(QUIET, noise=0.02, outlier_probability=0.1, miss_probability=0.2)
    poses = np.zeros((4000, 3))
    readings = simulate_sonar(ROOM, poses, noisy, np.random.default_rng(2), AHEAD)[:, 0]
    # Five standard errors of a share of 4,000; of the mean of 2,800; of their standard deviation.
    assert np.isinf(readings).mean() == pytest.approx(0.2, abs=5 * math.sqrt(0.16 / 4000))
    near = readings[np.abs(readings - 4.0) < 0.1]
    assert len(near) / 4000 == pytest.approx(0.7 + 0.1 * 0.2 / 8.0, abs=5 * math.sqrt(0.21 / 4000))
    assert near.mean() == pytest.approx(4.0, abs=5 * 0.02 / math.sqrt(2800))
    assert near.std() == pytest.approx(0.02, rel=0.1)


def test_an_empty_world_and_a_far_wall_return_nothing() -> None:
    assert heard(np.empty((0, 4)), 0.0) == math.inf
    assert heard(ROOM, 0.0, dataclasses.replace(QUIET, max_range=3.9)) == math.inf


def test_a_maximum_range_that_no_sonar_has_is_refused() -> None:
    with pytest.raises(ConfigError, match="sonar-max-range"):
        SonarPhysics(max_range=0.0)
