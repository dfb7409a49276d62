from __future__ import annotations

import math

import numpy as np
import pytest

from prf.model.window import BOTTOM, LEFT, RIGHT, SIDES, TOP, Window
from prf.shell.errors import ConfigError

WINDOW = Window(-1.0, 2.0, 3.0, 5.0)


def test_measures() -> None:
    assert (WINDOW.width, WINDOW.height, WINDOW.area, WINDOW.perimeter) == (4.0, 3.0, 12.0, 14.0)
    assert WINDOW.centre == (1.0, 3.5)
    assert WINDOW.to_array().tolist() == [-1.0, 2.0, 3.0, 5.0]


def test_sides_are_numbered_counter_clockwise_from_the_bottom() -> None:
    assert SIDES == (BOTTOM, RIGHT, TOP, LEFT) == (0, 1, 2, 3)
    assert [WINDOW.side_coordinate(side) for side in SIDES] == [2.0, 3.0, 5.0, -1.0]
    assert [WINDOW.side_length(side) for side in SIDES] == [4.0, 3.0, 4.0, 3.0]


def test_contains_is_closed_and_false_for_nan() -> None:
    points = [(-1.0, 2.0), (3.0, 5.0), (3.0 + 1e-12, 4.0), (0.0, math.nan), (0.0, 3.0)]
    np.testing.assert_array_equal(WINDOW.contains(points), [True, True, False, False, True])
    assert WINDOW.contains([]).shape == (0,)


@pytest.mark.parametrize("bounds", [(0, 0, 0, 1), (0, 1, 1, 0), (math.nan, 0, 1, 1), (0, 0, math.inf, 1)])
def test_an_impossible_window_is_a_config_error(bounds: tuple[float, float, float, float]) -> None:
    with pytest.raises(ConfigError, match="window"):
        Window.checked(*bounds)


def test_checked_makes_floats() -> None:
    window = Window.checked(0, 0, 2, 1)
    assert window == Window(0.0, 0.0, 2.0, 1.0)
    assert all(type(bound) is float for bound in window)
