"""Directions of a building: their law by quadrature, draws of the prior, the direction of walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import i0e

from prf.kernels import constants as c
from prf.model.arak import exact_draws, expected_edges
from prf.model.orientation import (
    PLAIN,
    Orientation,
    crossing_rate,
    line_law,
    log_normaliser,
    pair_factor,
    unwrapped,
    wall_direction,
)
from prf.model.window import Window
from prf.shell.errors import ConfigError
from tests.reference.slow_coloring import line_measure, slow_rate

WINDOW = Window(0.0, 0.0, 2.0, 1.0)


@pytest.mark.parametrize(("strength", "angle"), [(0.0, 0.3), (0.7, 0.3), (3.0, 1.2), (10.0, 0.0)])
def test_the_series_is_the_integral(strength: float, angle: float) -> None:
    for direction in (0.0, 0.2, 0.9, 2.1):
        found = crossing_rate(strength, math.cos(4.0 * (direction - angle)), 0.3)
        assert found == pytest.approx(slow_rate(direction, 0.3, strength, angle), rel=1e-7)
    crossed = quad(lambda t: line_measure(t, strength, angle) * slow_rate(t, 0.5, strength, angle), 0.0, math.pi)
    assert pair_factor(strength) == pytest.approx(crossed[0] / math.pi, rel=1e-6)
    assert line_law(strength, angle, 0.3, WINDOW)[c.LOG_MEAN] == pytest.approx(math.log(i0e(strength)) + strength)


def test_without_a_preference_nothing_is_added() -> None:
    assert log_normaliser(0.0, 0.4, 0.3, WINDOW) == 0.0
    assert not line_law(0.0, 0.0, 0.3, WINDOW)[c.FIRST_TERM :].any()
    assert expected_edges(0.3, WINDOW, Orientation(0.0)) == expected_edges(0.3, WINDOW)
    assert not Orientation(0.0, None).is_sampled
    assert Orientation(0.0, None).draw(np.random.default_rng(1)) == (0.0, 0.0)


def test_what_is_sampled_is_drawn_from_its_prior() -> None:
    rng = np.random.default_rng(2)
    drawn = np.array([Orientation(None, None).draw(rng) for _ in range(4000)])
    mean = 2.0 - 10.0 / math.expm1(5.0)
    assert abs(drawn[:, 0].mean() - mean) < 4.5 * drawn[:, 0].std() / math.sqrt(len(drawn))
    assert drawn[:, 0].max() <= 10.0
    assert abs(drawn[:, 1].mean() - math.pi / 4.0) < 4.5 * drawn[:, 1].std() / math.sqrt(len(drawn))
    assert Orientation.of("sampled", 0.2) == Orientation(None, 0.2)


def test_free_space_is_paid_for_by_rejection() -> None:
    with pytest.raises(ConfigError, match="--method mcmc"):
        exact_draws(1.0, WINDOW, 10, np.random.default_rng(1), PLAIN, 20.0)


def test_the_direction_of_walls_is_that_of_most_metres() -> None:
    """A room of long walls at 12 degrees among ten times as many splinters in all directions."""
    rng = np.random.default_rng(3)
    angle = math.radians(12.0)
    walls = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]] * 4) * 5.0
    around = rng.uniform(0.0, math.pi, 80)
    splinters = 0.3 * np.column_stack([np.cos(around), np.sin(around)])
    found = wall_direction(np.concatenate([walls, splinters]), np.zeros(88, np.int64), 1)
    assert math.degrees(found[0]) == pytest.approx(12.0, abs=0.2)


def test_angles_are_unwrapped_about_their_mean() -> None:
    angles = np.radians([89.0, 1.0, 88.0, 2.0])
    assert np.degrees(unwrapped(angles)) % 90.0 == pytest.approx([89.0, 1.0, 88.0, 2.0])
    assert np.ptp(np.degrees(unwrapped(angles))) == pytest.approx(4.0)
