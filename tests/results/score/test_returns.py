"""What a beam will meet: walls as far off as readings are, and clutter as often as the readings met it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from prf.model.coloring import Coloring, Draws, from_polygons
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.readings import Readings
from prf.readings.counts import beam_counts
from prf.results.estimate import occupied_probability
from prf.results.score.returns import Returns, evidence, return_probability, returns_of

ROOM = Window(0.0, 0.0, 10.0, 10.0)
WALL = shapely.box(7.0, 0.5, 8.0, 9.5)
MODEL = LaserModel(max_range=9.0, noise=0.03, noise_relative=0.0)
ERROR = 0.06
"""Metres by which the readings here lie about the wall."""
CROWD = 0.4
"""Unexplained returns a metre of beam that is below 4 m in x, above 6 m in y."""


def beams(seed: int, n: int = 20_000) -> Readings:
    """Beams from the left part of the room to the right, of which some end at people in its upper left part."""
    rng = np.random.default_rng(seed)
    origin = np.column_stack([rng.uniform(0.5, 1.5, n), rng.uniform(1.0, 9.0, n)])
    angle = rng.uniform(-0.3, 0.3, n)
    wall = (7.0 - origin[:, 0]) / np.cos(angle)
    height = origin[:, 1] + wall * np.sin(angle)
    met = wall + rng.normal(0.0, ERROR, n)
    crowd = rng.exponential(1.0 / CROWD, n)
    x, y = origin[:, 0] + crowd * np.cos(angle), origin[:, 1] + crowd * np.sin(angle)
    stopped = (x < 4.0) & (y > 6.0)
    missed = (height < 0.6) | (height > 9.4)
    ranges = np.where(stopped, crowd, np.where(missed, np.inf, met))
    return Readings.from_arrays(origin, angle, ranges).within(MODEL.limit)


@pytest.fixture(scope="module")
def draws() -> Draws:
    return Draws.from_colorings([from_polygons(WALL, ROOM)] * 40)


@pytest.fixture(scope="module")
def returns(draws: Draws) -> Returns:
    return returns_of(draws, beams(1), MODEL)


def test_the_spread_is_that_of_the_readings_about_the_wall(returns: Returns) -> None:
    # Normal to the wall and along the beam differ by the cosine of at most 0.3; outliers are cut at 0.2 m.
    assert returns.spread == pytest.approx(ERROR, rel=0.1)


def test_clutter_is_met_as_often_as_the_readings_did(returns: Returns) -> None:
    upper = [(x, y) for x in np.arange(2.1, 3.8, 0.2) for y in np.arange(7.1, 8.2, 0.2)]
    rates = -np.log1p(-returns.clutter(np.array(upper), 0.2)) / (0.25 * math.pi * 0.2)
    assert rates.mean() == pytest.approx(CROWD, rel=0.1)
    assert returns.clutter(np.array([[3.0, 3.0]]), 0.2)[0] < 0.005


def test_a_map_alone_is_too_sure_where_readings_are_not(draws: Draws, returns: Returns) -> None:
    """Of other readings: beside the wall, where a map is sure, and among people, of which it knows nothing."""
    held = beams(2)
    ends = held.origin + held.range[:, None] * np.column_stack([np.cos(held.angle), np.sin(held.angle)])
    ends = ends[held.range < MODEL.limit]

    def nats(p: np.ndarray) -> float:
        return float(-np.log(np.clip(p, 1e-3, 1.0)).mean())

    known = nats(return_probability(draws, returns, ends, 0.2))
    assert known < 0.6 * nats(occupied_probability(draws, ends, 0.2))
    free = np.column_stack([np.linspace(2.0, 6.5, 40), np.full(40, 3.0)])
    assert return_probability(draws, returns, free, 0.2).max() < 0.01


def test_draws_count_as_often_as_they_have_a_wall(returns: Returns) -> None:
    mixed = Draws.from_colorings([from_polygons(WALL, ROOM), Coloring.empty(ROOM)] * 300)
    wall, ratio, number, *_ = evidence(mixed, returns, np.array([[7.5, 3.0], [-1.0, 3.0]]), 0.2).T
    assert 1.0 / (1.0 + math.exp(-wall[0])) == pytest.approx(0.5 * returns.explained, abs=0.02)
    assert ratio[0] == number[0] == 0.0, "no beam came so far"
    assert math.isnan(return_probability(mixed, returns, np.array([[-1.0, 3.0]]), 0.2)[0])


def test_places_that_beams_cross_and_end_in_speak_for_themselves(returns: Returns) -> None:
    """In draws that know nothing of the wall: where beams ended, p_return is high all the same."""
    empty = Draws.from_colorings([Coloring.empty(ROOM)] * 40)
    wall, crossed, beyond = return_probability(empty, returns, np.array([[6.98, 3.0], [6.0, 3.0], [9.0, 3.0]]), 0.2)
    assert wall > 0.5
    assert crossed < 1e-3
    assert crossed < beyond < 0.5


def test_counts_of_all_beams_are_taken_where_they_are_known(draws: Draws) -> None:
    few, many = beams(1).select(np.arange(500)), beams(1)
    counts = beam_counts(ROOM, many)
    xy = np.array([[6.98, 3.0], [3.0, 7.0]])
    found = evidence(draws, returns_of(draws, few, MODEL, counts), xy, 0.2)
    np.testing.assert_array_equal(found[:, 1:3], evidence(draws, returns_of(draws, many, MODEL), xy, 0.2)[:, 1:3])
    assert (found[:, 2] > evidence(draws, returns_of(draws, few, MODEL), xy, 0.2)[:, 2] + 2.0).all()


def test_no_beam_ends_in_a_point(draws: Draws, returns: Returns) -> None:
    xy = np.array([[6.95, 3.0], [3.0, 3.0]])
    found = return_probability(draws, returns, xy, 0.0)
    np.testing.assert_array_equal(found, return_probability(draws, returns, xy, 0.2))


def test_without_a_laser_it_is_the_share_of_draws(draws: Draws) -> None:
    xy = np.array([[6.95, 3.0], [3.0, 3.0], [11.0, 3.0]])
    np.testing.assert_array_equal(return_probability(draws, None, xy, 0.2), occupied_probability(draws, xy, 0.2))


def test_readings_without_noise_have_a_spread(draws: Draws) -> None:
    exact = Readings.from_arrays(np.full((5, 2), 2.0), np.zeros(5), np.full(5, 5.0)).within(MODEL.limit)
    assert returns_of(draws, exact, MODEL).spread == pytest.approx(0.1 * MODEL.noise)


def test_a_run_without_a_return_has_a_usual_rate(draws: Draws) -> None:
    nothing = Readings.from_arrays(np.array([[1.0, 1.0]]), np.array([math.pi]), np.array([np.inf])).within(MODEL.limit)
    found = returns_of(draws, nothing, MODEL)
    assert found.spread == MODEL.noise
    assert np.isfinite(found.rate).all()
