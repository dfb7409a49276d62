"""Small quadratic programs: the conditions that mark their optimum, and optima known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.quadratic import solve_quadratic

NEAR = 1e-6
"""Of the largest number; the worst of these programs comes within a tenth of it, half of them within 1e-10."""


@pytest.mark.parametrize("start", range(0, 200, 50))
def test_the_optimality_conditions_hold_in_units_of_the_largest_number(start):
    for seed in range(start, start + 50):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(1, 9)), int(rng.integers(1, 30))
        left, right = rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m)
        curvature, slope = rng.uniform(0.01, 2.0, n), rng.normal(size=n)
        z, multiplier = solve_quadratic(curvature, slope, left, right)
        size = 1.0 + max(np.abs(slope).max(), right.max())
        assert (left @ z - right).max() < NEAR * size, seed
        assert (multiplier > 0.0).all(), seed
        assert np.abs(curvature * z + slope + left.T @ multiplier).max() < NEAR * size, seed
        assert np.abs(multiplier * (right - left @ z)).max() < NEAR * size, seed


def test_a_bound_that_holds_back_has_the_slope_as_its_multiplier():
    z, multiplier = solve_quadratic(
        np.array([2.0, 4.0]), np.array([-6.0, 4.0]), np.array([[1.0, 0.0]]), np.array([1.0])
    )
    np.testing.assert_allclose(z, [1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(multiplier, [4.0], atol=1e-9)


def test_bounds_that_the_start_breaks_are_kept_at_the_end():
    """Least z1^2/2 + z2^2/2 with z1 >= 1, z1 + z2 >= 3 and z2 <= 1/2: at (5/2, 1/2) the last two hold."""
    left = np.array([[-1.0, 0.0], [-1.0, -1.0], [0.0, 1.0]])
    z, multiplier = solve_quadratic(np.ones(2), np.zeros(2), left, np.array([-1.0, -3.0, 0.5]))
    np.testing.assert_allclose(z, [2.5, 0.5], atol=1e-8)
    np.testing.assert_allclose(multiplier, [0.0, 2.5, 2.0], atol=1e-8)


def test_directions_without_curvature_go_to_the_bounds():
    """Least z1 + z2 with z1 >= -1, z2 >= -2 and z1 + z2 >= -2.5: the last holds, as in the risk of a part."""
    left = np.array([[-1.0, 0.0], [0.0, -1.0], [-1.0, -1.0]])
    z, multiplier = solve_quadratic(np.zeros(2), np.ones(2), left, np.array([1.0, 2.0, 2.5]))
    assert z.sum() == pytest.approx(-2.5, abs=1e-8)
    np.testing.assert_allclose(multiplier, [0.0, 0.0, 1.0], atol=1e-8)


def test_a_direction_that_nothing_holds_back_and_nothing_draws_makes_no_harm():
    """Least z1 + z2 with z1 + z2 >= -1: z1 - z2 is free, and the matrix of a step singular."""
    z, multiplier = solve_quadratic(np.zeros(2), np.ones(2), np.array([[-1.0, -1.0]]), np.ones(1))
    assert z.sum() == pytest.approx(-1.0, abs=1e-8)
    assert multiplier == pytest.approx([1.0], abs=1e-8)


def test_constraints_that_nearly_agree_do_no_harm():
    left = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-12], [1.0 + 1e-12, 1.0]])
    z, multiplier = solve_quadratic(np.ones(2), np.array([-2.0, -2.0]), left, np.ones(3))
    np.testing.assert_allclose(z, [0.5, 0.5], atol=1e-8)
    assert multiplier.sum() == pytest.approx(1.5, abs=1e-8)
