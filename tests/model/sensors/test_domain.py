"""Bounds of parameters: what is just inside is taken, what is just outside is not."""

from __future__ import annotations

import math

import pytest

from prf.model.domain import MAX_FACTOR, MIN_LENGTH, check_factor, check_length
from prf.model.laser import LaserModel
from prf.model.sonar import SonarModel
from prf.model.window import LARGEST_RANGE
from prf.shell.errors import ConfigError


def test_lengths() -> None:
    for value in (MIN_LENGTH, 1.0, LARGEST_RANGE):
        check_length("noise", value)
    for value in (math.nextafter(MIN_LENGTH, 0.0), math.nextafter(LARGEST_RANGE, math.inf), -1.0, 0.0, math.nan):
        with pytest.raises(ConfigError, match=r"^noise .*: must be a positive number of metres, from 1e-09 to 1e\+06$"):
            check_length("noise", value)


@pytest.mark.parametrize("least", [-MAX_FACTOR, 0.0])
def test_factors(least: float) -> None:
    given = () if least < 0.0 else (least,)
    for value in (least, 1.0, MAX_FACTOR):
        check_factor("bias", value, *given)
    for value in (math.nextafter(least, -math.inf), math.nextafter(MAX_FACTOR, math.inf), math.nan):
        with pytest.raises(ConfigError, match=r"^bias .*: must be a number from (-1e\+06|0) to 1e\+06$"):
            check_factor("bias", value, *given)


@pytest.mark.parametrize("limits", [(1e-9, 1e-100), (1e6, 1e-100), (1e-9, 0.9), (1e6, 0.9)])
def test_at_the_bounds_all_numbers_of_a_density_are_finite(limits: tuple[float, float]) -> None:
    length, probability = limits
    laser = LaserModel(length, length, MAX_FACTOR, probability, 0.0)
    assert all(math.isfinite(value) for value in laser.to_array())
    sonar = SonarModel(length, length, uniform_probability=probability, short_probability=0.0, short_length=length)
    assert all(math.isfinite(value) for value in sonar.to_array())
