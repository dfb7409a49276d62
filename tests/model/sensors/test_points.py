"""Parameters that sensors refuse; those of the point observations, what they resolve to, the window round points."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from prf.model.points import estimated_sigma, log_density, resolved, window_round
from prf.model.ranges import laser_array, sonar_array
from prf.model.sensors import MAX_FACTOR, LaserModel, PointModel, SonarModel
from prf.shell.errors import ArgumentError, ConfigError
from tests.reference.slow_points import Flips, Normal, lattice, most_likely_sigma


@pytest.mark.parametrize(
    ("model", "field", "values"),
    [
        (LaserModel(10.0), "max_range", (0.0, math.inf, math.nan)),
        (LaserModel(10.0), "noise", (0.0, 1e-300, 1e300)),
        (LaserModel(10.0), "noise_relative", (-0.01, math.inf)),
        (LaserModel(10.0), "outlier_probability", (0.0, 1e-320, 1.0, math.nan)),
        (LaserModel(10.0), "miss_probability", (-0.1, 1.0)),
        (SonarModel(), "max_range", (0.0, math.inf)),
        (SonarModel(), "noise", (0.0, 1e-300, math.nan)),
        (SonarModel(), "noise_relative", (-0.1, 1e300)),
        (SonarModel(), "surface_bias", (-1e300, math.nan)),
        (SonarModel(), "uniform_probability", (0.0, 1e-320, 1.0)),
        (SonarModel(), "short_probability", (-0.1, 0.8)),
        (PointModel(), "kind", ("laplace",)),
        (PointModel(), "mean_black", (math.nan, 0.0)),
        (PointModel(), "sigma", (0.0,)),
        (PointModel(), "flip_probability", (0.5,)),
    ],
)
def test_parameters_without_a_density_are_refused(model: Any, field: str, values: tuple[object, ...]) -> None:
    for value in values:
        with pytest.raises(ArgumentError, match=f"^{field}"):
            model.replace(**{field: value})


def test_the_kind_follows_from_the_values_unless_it_is_given() -> None:
    assert resolved(PointModel(), np.array([0.0, 1.0, 1.0])).kind == "binary"
    assert resolved(PointModel(), np.array([0.0, 1.0, 0.5])).kind == "gaussian"
    assert resolved(PointModel("gaussian", sigma=0.2), np.array([0.0, 1.0])) == PointModel("gaussian", sigma=0.2)
    with pytest.raises(ConfigError, match=r"a value is 0\.5, neither 0 nor 1"):
        resolved(PointModel("binary"), np.array([0.0, 1.0, 0.5, 2.0]))


@pytest.mark.parametrize("law", [Normal(), Normal(-3.0, 40.0, 11.0), Flips(), Flips(0.01)], ids=str)
def test_densities_are_those_written(law: Normal | Flips) -> None:
    rng = np.random.default_rng(40)
    values = law.draw(rng.random(200) < 0.5, rng)
    expected = [[law.log_density(value, black) for black in (False, True)] for value in values.tolist()]
    assert log_density(law.model, values) == pytest.approx(np.array(expected), rel=1e-12)


def test_densities_beyond_double_precision_are_refused() -> None:
    with pytest.raises(ConfigError, match="points-sigma 1e-200: too small"):
        log_density(PointModel("gaussian", sigma=1e-200), np.array([0.0, 3.0]))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("sigma", [0.05, 0.5, 2.0])
def test_sigma_is_estimated_whatever_the_share_of_black(sigma: float, share: float) -> None:
    rng = np.random.default_rng(41)
    law = Normal(5.0, 3.0, 2.0 * sigma)
    values = law.draw(rng.random(20_000) < share, rng)
    assert estimated_sigma(values, 5.0, 3.0) == pytest.approx(2.0 * sigma, rel=0.05)
    found = resolved(PointModel("gaussian", 5.0, 3.0), values)
    assert found.sigma == estimated_sigma(values, 5.0, 3.0)


@pytest.mark.parametrize(("black", "white"), [(1.0, 0.0), (0.0, 1.0), (-1.0, 1.0), (3.0, 5.0)])
@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("noise", [0.3, 0.6])
def test_sigma_is_the_most_likely_one_in_any_unit(black: float, white: float, unit: float, noise: float) -> None:
    rng = np.random.default_rng(43)
    law = Normal(black, white, noise * abs(black - white))
    for share in (0.15, 0.5, 0.7):
        values = law.draw(rng.random(61) < share, rng)
        with np.errstate(divide="raise", invalid="raise"):
            sigma = estimated_sigma(unit * values, unit * black, unit * white) / unit
        assert sigma == pytest.approx(most_likely_sigma(values, black, white), rel=1e-6)


@pytest.mark.parametrize("off", [[-0.05, 0.05], [-0.145, 0.145], [-0.2, 0.2], [0.95, 1.05]])
def test_values_of_one_colour_have_their_deviation_from_its_mean(off: list[float]) -> None:
    """Also where all lie beyond the mean, or where the share of the other colour vanishes within a round."""
    expected = math.sqrt(np.mean(np.square(off)))
    assert estimated_sigma(1.0 + np.array(off), 1.0, 0.0) == pytest.approx(expected, rel=1e-6)
    assert estimated_sigma(-np.array(off), 1.0, 0.0) == pytest.approx(expected, rel=1e-6)


def test_a_bitmap_fills_the_window_round_it() -> None:
    assert window_round(lattice(8, 2.0, 6.0)) == pytest.approx((2.0, 2.0, 6.0, 6.0))
    assert window_round(np.tile(lattice(8, 2.0, 6.0), (3, 1))) == pytest.approx((2.0, 2.0, 6.0, 6.0))


def test_the_window_round_few_points() -> None:
    assert window_round(np.array([[3.0, 4.0], [3.0, 4.0]])) == (2.0, 3.0, 4.0, 5.0)
    assert window_round(np.array([[0.0, 0.0], [4.0, 0.0]])) == (-2.0, -2.0, 6.0, 2.0)
    assert window_round(np.array([[0.0, 0.0], [2.0, 0.0], [5.0, 0.0]])) == (-1.0, -1.0, 6.0, 1.0)


# Bounds of parameters: what is just inside is taken, what is just outside is not.


@pytest.mark.parametrize("limits", [(1e-9, 1e-100), (1e6, 1e-100), (1e-9, 0.9), (1e6, 0.9)])
def test_at_the_bounds_all_numbers_of_a_density_are_finite(limits: tuple[float, float]) -> None:
    length, probability = limits
    laser = LaserModel(length, length, MAX_FACTOR, probability, 0.0)
    assert all(math.isfinite(value) for value in laser_array(laser))
    sonar = SonarModel(length, length, uniform_probability=probability, short_probability=0.0, short_length=length)
    assert all(math.isfinite(value) for value in sonar_array(sonar))
