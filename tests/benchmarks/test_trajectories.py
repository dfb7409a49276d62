"""Figures of the benchmark of trajectories, on poses whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import trajectories
from prf.poses.plane import compose

ALONG = np.linspace(0.0, 6.0, 400)
TRUTH = np.column_stack([5.0 * np.cos(ALONG), 4.0 * np.sin(ALONG), np.full(400, 3.14)])


def test_errors_are_root_mean_squares_and_headings_are_turns() -> None:
    found = trajectories.errors(TRUTH + np.array([0.3, -0.4, 0.01 - 2.0 * np.pi]), TRUTH)
    assert (found["metres"], found["radians"]) == pytest.approx((0.5, 0.01))


def test_evo_aligns_before_it_judges() -> None:
    pytest.importorskip("evo")
    moved = compose(np.array([[1.0, 2.0, 0.7]]), TRUTH)
    noise = np.random.default_rng(1).normal(0.0, 0.02, (400, 2))
    found = trajectories.evo_errors(moved + np.column_stack([noise, np.zeros(400)]), TRUTH)
    assert found == pytest.approx({"ate": 0.02 * 2**0.5, "rpe": 0.04}, rel=0.08)


def test_intervals_hold_the_truth_as_often_as_they_should() -> None:
    sd = np.full((400, 3), 0.1)
    error = np.random.default_rng(2).normal(0.0, [0.1, 0.2, 0.1], (400, 3))
    sd[0], error[0] = 0.0, 5.0
    found = trajectories.held(TRUTH + error, sd, TRUTH)
    assert found == pytest.approx({"x": 0.95, "y": 0.67, "heading": 0.95}, abs=0.05)
