"""The exact laws as functions: values by hand, by simulation long ago, and from one another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate

from prf.model import arak
from prf.model.arak import exact_draws
from prf.model.window import Window
from tests.reference import arak_laws
from tests.reference.arak_laws import log_partition

UNIT = Window(0.0, 0.0, 1.0, 1.0)
OBLONG = Window(3.0, -1.5, 5.0, -0.5)


def test_means_of_the_unit_square() -> None:
    assert arak.expected_edges(1.0, UNIT) == pytest.approx(4.0 + 4.0 * math.pi)  # Paskin & Thrun, section 1.3.2
    assert arak.expected_edges(0.5, OBLONG) == pytest.approx(9.283, abs=1e-3)
    assert arak.expected_length(2.0, UNIT) == pytest.approx(6.283, abs=1e-3)


def test_laws_agree_with_one_another() -> None:
    p = 0.8
    ends = 2.0 * arak_laws.expected_interior_vertices(p, OBLONG) + arak_laws.expected_boundary_vertices(p, OBLONG)
    assert arak.expected_edges(p, OBLONG) == pytest.approx(0.5 * ends)
    assert arak_laws.expected_interior_vertices(p, OBLONG) == pytest.approx(
        4.0 * arak_laws.expected_extremes(p, OBLONG)
    )
    sides = sum(arak_laws.expected_crossings(p, OBLONG.side_length(side)) for side in range(4))
    assert arak_laws.expected_boundary_vertices(p, OBLONG) == pytest.approx(sides)
    free = arak_laws.no_edge_probability(p, OBLONG.perimeter, OBLONG.area)
    assert free == pytest.approx(2.0 * math.exp(-log_partition(p, OBLONG)))
    # A segment is a convex set with twice its length for perimeter.
    assert arak_laws.no_edge_probability(p, 2.0 * 0.3, 0.0) == pytest.approx(
        math.exp(-arak_laws.expected_crossings(p, 0.3))
    )
    assert arak_laws.edge_length_rate(p) == pytest.approx(
        arak_laws.expected_interior_vertices(p, UNIT) / arak.expected_length(p, UNIT)
    )


def test_colours_far_apart_are_independent() -> None:
    assert arak_laws.same_colour_probability(1.0, 0.0) == 1.0
    assert arak_laws.same_colour_probability(1.0, 100.0) == 0.5
    assert arak_laws.four_point_correlation(1.0, 0.1, 0.2) == pytest.approx(
        (2 * arak_laws.same_colour_probability(1.0, 0.1) - 1) * (2 * arak_laws.same_colour_probability(1.0, 0.2) - 1)
    )


@pytest.mark.parametrize(
    ("scale", "value"), [(0.1, 0.2039), (0.5, 0.0991), (1.0, 0.0483), (2.0, 0.0174), (4.0, 0.0052)]
)
def test_black_variance_of_the_unit_square(scale: float, value: float) -> None:
    assert arak_laws.black_fraction_variance(scale, UNIT) == pytest.approx(value, abs=1e-4)


@pytest.mark.parametrize("window", [UNIT, OBLONG, Window(0.0, 0.0, 12.0, 0.5)])
def test_black_variance_agrees_with_adaptive_quadrature(window: Window) -> None:
    def integrand(v: float, u: float) -> float:
        return (window.width - u) * (window.height - v) * math.exp(-4.0 * 0.6 * math.hypot(u, v))

    total, _ = integrate.dblquad(integrand, 0.0, window.width, 0.0, window.height, epsabs=1e-11, epsrel=1e-11)
    assert arak_laws.black_fraction_variance(0.6, window) == pytest.approx(total / window.area**2, rel=1e-7)


def test_black_variance_of_a_dense_field_is_that_of_a_plane() -> None:
    """Far from the border the integral of exp(-4 p r) over the plane is 2 pi / (4 p)^2."""
    value = arak_laws.black_fraction_variance(50.0, Window(0.0, 0.0, 100.0, 80.0))
    assert value == pytest.approx(0.25 * 2.0 * math.pi / 200.0**2 / 8000.0, rel=1e-3)


def test_compare_puts_means_beside_the_laws() -> None:
    draws = exact_draws(1.0, OBLONG, 2000, np.random.default_rng(1))
    found = arak.compare(draws, 1.0)
    assert found.n_draws == 2000
    assert found.mean_edges == draws.n_edges.mean()
    assert found.expected_edges == arak.expected_edges(1.0, OBLONG)
    assert found.mean_edges == pytest.approx(found.expected_edges, rel=0.05)
    assert found.mean_length == pytest.approx(found.expected_length, rel=0.05)
