"""The prior: density by hand and against a slow twin, exact draws as compiled and as plain Python."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate

from prf.configuration import Prior
from prf.model import arak
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, violations
from prf.model.window import BOTTOM, INTERIOR, LEFT, TOP, Window
from prf.sampler.prior import mcmc_draws
from prf.shell.errors import ConfigError
from tests.reference import arak_laws
from tests.reference.arak_laws import log_density, log_partition
from tests.reference.slow_coloring import slow_log_density

UNIT = Window(0.0, 0.0, 1.0, 1.0)
OBLONG = Window(3.0, -1.5, 5.0, -0.5)
FAR = Window(1e6, -3e5, 1e6 + 40.0, -3e5 + 30.0)


def digest(draws: Draws, rng: np.random.Generator) -> str:
    total = hashlib.sha256()
    for name in ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black"):
        total.update(getattr(draws, name).tobytes())
    total.update(repr(rng.bit_generator.state).encode())
    return total.hexdigest()


def three_digests() -> list[str]:
    found = []
    for scale, window, n in ((1.0, UNIT, 100), (0.5, OBLONG, 50), (0.1, FAR, 3), (6.0, UNIT, 2)):
        rng = np.random.default_rng(5)
        found.append(digest(exact_draws(scale, window, n, rng), rng))
    return found


def test_compiled_draws_are_those_of_plain_python_bit_for_bit(project_root: Path) -> None:
    code = "from tests.model.test_arak import three_digests; print(*three_digests())"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(project_root)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split() == three_digests()


def test_draws_continue_from_the_state_of_the_generator() -> None:
    one, two = np.random.default_rng(9), np.random.default_rng(9)
    whole = exact_draws(1.0, UNIT, 20, one)
    parts = Draws.from_colorings([draw for n in (7, 0, 13) for draw in exact_draws(1.0, UNIT, n, two)])
    assert digest(whole, one) == digest(parts, two)


@pytest.mark.parametrize(
    ("scale", "window", "n"),
    [(1.0, UNIT, 3000), (0.5, OBLONG, 1500), (0.1, FAR, 60), (1e-4, UNIT, 300), (300.0, Window(0.0, 0.0, 0.1, 0.1), 1)],
)
def test_draws_are_valid(scale: float, window: Window, n: int) -> None:
    for draw in exact_draws(scale, window, n, np.random.default_rng(11)):
        assert violations(draw) == []


@pytest.mark.slow
def test_many_draws_are_valid() -> None:
    for draw in exact_draws(0.4, Window(-5.0, -5.0, 5.0, 5.0), 5000, np.random.default_rng(12)):
        assert violations(draw) == []


def test_fields_scale() -> None:
    """Field(p, D) = field(1, p D) / p: the same random numbers make the same graph, larger."""
    small = exact_draws(1.0, UNIT, 30, np.random.default_rng(13))
    large = exact_draws(0.25, Window(0.0, 0.0, 4.0, 4.0), 30, np.random.default_rng(13))
    np.testing.assert_array_equal(small.edges, large.edges)
    np.testing.assert_allclose(4.0 * small.xy, large.xy, rtol=1e-12)


def test_wrong_arguments_are_config_errors() -> None:
    rng = np.random.default_rng(1)
    for scale in (0.0, -1.0, math.nan, math.inf, 1e308):
        with pytest.raises(ValueError, match="scale"):
            Prior(scale=scale)
    with pytest.raises(ConfigError, match="draws"):
        exact_draws(1.0, UNIT, -1, rng)
    assert len(exact_draws(1.0, UNIT, 0, rng)) == 0


@pytest.mark.parametrize(("scale", "n_draws"), [(1e5, 1), (1.0, 10**20)])
def test_too_many_draws_are_refused(scale: float, n_draws: int) -> None:
    for draw in (
        lambda: exact_draws(scale, UNIT, n_draws, np.random.default_rng(1)),
        lambda: mcmc_draws(scale, UNIT, n_draws),
    ):
        with pytest.raises(ConfigError, match=r"would have about .* edges\. Give a smaller scale"):
            draw()


def test_log_density_by_hand() -> None:
    xy = np.array([[0.2, 0.2], [0.6, 0.2], [0.2, 0.5]])
    edges = np.array([[0, 1], [1, 2], [2, 0]], np.int32)
    triangle = Coloring(UNIT, xy, np.full(3, INTERIOR, np.int8), edges, False)
    p, perimeter, circumradius = 0.7, 1.2, 0.25
    expected = 3 * math.log(p) - 2 * p * perimeter - math.log(8 * circumradius**3)
    assert log_density(triangle, p) == pytest.approx(expected)
    cut = Coloring(
        UNIT, np.array([[0.3, 0.0], [0.0, 0.4]]), np.array([BOTTOM, LEFT], np.int8), edges[:1], anchor_black=True
    )
    expected = math.log(p) - 2 * p * 0.5 - math.log(0.5) + math.log(0.8) + math.log(0.6)
    assert log_density(cut, p) == pytest.approx(expected)
    assert log_density(Coloring.empty(UNIT), p) == 0.0


def test_log_density_agrees_with_a_slow_twin() -> None:
    for draw in exact_draws(1.0, OBLONG, 50, np.random.default_rng(14)):
        assert log_density(draw, 1.3) == pytest.approx(slow_log_density(draw, 1.3), abs=1e-9)


def test_a_straight_joint_has_density_zero() -> None:
    xy = np.array([[0.5, 0.0], [0.5, 0.5], [0.5, 1.0]])
    edges = np.array([[0, 1], [1, 2]], np.int32)
    assert log_density(Coloring(UNIT, xy, np.array([BOTTOM, INTERIOR, TOP], np.int8), edges, False), 1.0) == -math.inf


def test_log_partition() -> None:
    assert log_partition(0.5, OBLONG) == pytest.approx(math.log(2.0) + 0.5 * 6.0 + math.pi * 0.25 * 2.0)


def single_edge_weight(p: float, adjacent: bool) -> float:
    """Integrate h over one edge between two given sides of the unit square, adjacent or opposite."""

    def h(s: float, t: float) -> float:
        dx, dy = (s, t) if adjacent else (s - t, 1.0)
        length = math.hypot(dx, dy)
        sines = dx * dy / length**2 if adjacent else 1.0 / length**2
        return p * math.exp(-2.0 * p * length) / length * sines

    return float(integrate.dblquad(h, 0.0, 1.0, 0.0, 1.0, epsabs=1e-6)[0])


def test_density_and_partition_function_agree_with_the_exact_draws() -> None:
    """P(one edge that joins two given sides, and nothing else) = 2 / Z times the integral of h over its two ends."""
    p, n = 0.4, 40_000
    draws = exact_draws(p, UNIT, n, np.random.default_rng(16))
    single = np.flatnonzero(draws.n_edges == 1)
    sides = np.sort(draws.side[draws.vertex_offsets[single][:, None] + [0, 1]], axis=1)
    for pair, adjacent in (((0, 1), True), ((0, 2), False), ((1, 2), True), ((0, 3), True), ((1, 3), False)):
        probability = 2.0 * single_edge_weight(p, adjacent) / math.exp(log_partition(p, UNIT))
        found = np.count_nonzero((sides == pair).all(axis=1)) / n
        z = (found - probability) / math.sqrt(probability * (1.0 - probability) / n)
        assert abs(z) < 4.5, f"sides {pair}: {found} for {probability}, z = {z:.2f}, seed 16, false alarm 3.4e-5"


# The exact laws as functions: values by hand, by simulation long ago, and from one another.


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


@pytest.mark.parametrize("window", [UNIT, OBLONG, Window(0.0, 0.0, 12.0, 0.5)])
def test_black_variance_agrees_with_adaptive_quadrature(window: Window) -> None:
    def integrand(v: float, u: float) -> float:
        return (window.width - u) * (window.height - v) * math.exp(-4.0 * 0.6 * math.hypot(u, v))

    total, _ = integrate.dblquad(integrand, 0.0, window.width, 0.0, window.height, epsabs=1e-11, epsrel=1e-11)
    assert arak_laws.black_fraction_variance(0.6, window) == pytest.approx(total / window.area**2, rel=1e-7)


def test_compare_puts_means_beside_the_laws() -> None:
    draws = exact_draws(1.0, OBLONG, 2000, np.random.default_rng(1))
    found = arak.compare(draws, 1.0)
    assert found["n_draws"] == 2000
    assert found["mean_edges"] == draws.n_edges.mean()
    assert found["expected_edges"] == arak.expected_edges(1.0, OBLONG)
    assert found["mean_edges"] == pytest.approx(found["expected_edges"], rel=0.05)
    assert found["mean_length"] == pytest.approx(found["expected_length"], rel=0.05)


WINDOW = Window(-1.0, 2.0, 3.0, 5.0)


def test_contains_is_closed_and_false_for_nan() -> None:
    points = [(-1.0, 2.0), (3.0, 5.0), (3.0 + 1e-12, 4.0), (0.0, math.nan), (0.0, 3.0)]
    np.testing.assert_array_equal(WINDOW.contains(points), [True, True, False, False, True])
    assert WINDOW.contains([]).shape == (0,)


@pytest.mark.parametrize("bounds", [(0, 0, 0, 1), (0, 1, 1, 0), (math.nan, 0, 1, 1), (0, 0, math.inf, 1)])
def test_an_impossible_window_is_a_config_error(bounds: tuple[float, float, float, float]) -> None:
    with pytest.raises(ConfigError, match="window"):
        Window.checked(*bounds)
