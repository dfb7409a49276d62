"""Points, squares and paths over draws beside shapely; coverage of intervals on chains whose law is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
from scipy import stats

from prf.model.coloring import Coloring, Draws, occupied_polygons
from prf.model.window import Window
from prf.results.convergence import effective_size
from prf.results.estimate import (
    PIECE,
    blocking_piece,
    by_chain,
    cut_legs,
    estimates,
    nearby_ess,
    occupied_in_draws,
    occupied_probability,
    path_free,
    path_free_in_draws,
    probe_ess,
    smallest_ess,
)
from prf.shell.errors import InputError, UsageError
from tests.factories import WINDOW, make_run, random_draws, room_with

POSTS = (((3.2, 2.9, 3.3, 3.1), 2), ((6.6, 2.9, 6.7, 3.1), 3))
"""Boxes, and in one map of how many each stands."""


def random_points(seed: int, n: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(WINDOW[:2], WINDOW[2:], (n, 2))


def squares_by_shapely(draws: Draws, xy: np.ndarray, square: float) -> np.ndarray:
    half = 0.5 * square
    boxes = shapely.box(xy[:, 0] - half, xy[:, 1] - half, xy[:, 0] + half, xy[:, 1] + half)
    # To GEOS before 3.13 a box that rounding leaves no area meets nothing.
    places = np.where(shapely.area(boxes) > 0.0, boxes, shapely.points(xy))
    return np.array([shapely.intersects(occupied_polygons(draw), places) for draw in draws])


def test_points_agree_with_shapely() -> None:
    draws, xy = random_draws(1, 20), random_points(2, 300)
    black = np.array([shapely.contains_xy(occupied_polygons(draw), xy) for draw in draws])
    np.testing.assert_array_equal(occupied_in_draws(draws, xy), black)
    np.testing.assert_allclose(occupied_probability(draws, xy), black.mean(axis=0), rtol=1e-14)


@pytest.mark.parametrize("square", [1e-3, 0.2, 1.0, 7.0, 100.0])
def test_squares_agree_with_shapely(square: float) -> None:
    draws, xy = random_draws(3, 20), random_points(4, 300)
    expected = squares_by_shapely(draws, xy, square)
    np.testing.assert_array_equal(occupied_in_draws(draws, xy, square), expected)
    np.testing.assert_allclose(occupied_probability(draws, xy, square), expected.mean(axis=0), rtol=1e-14)


def test_order_of_points_is_kept_and_the_outside_is_nan() -> None:
    draws = random_draws(5, 10)
    xy = np.vstack((random_points(6, 20), [[1e3, 0.0], [np.nan, 0.0]], random_points(7, 20)))
    probability = occupied_probability(draws, xy)
    assert np.flatnonzero(np.isnan(probability)).tolist() == [20, 21]
    for i in (0, 19, 22, 41):
        assert probability[i] == occupied_probability(draws, xy[i : i + 1])[0]
    assert occupied_probability(draws, np.empty((0, 2))).shape == (0,)


def test_batches_do_not_change_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    draws, xy = random_draws(5, 10), random_points(6, 100)
    whole = occupied_probability(draws, xy, 0.5)
    monkeypatch.setattr("prf.results.estimate.MOST_COLOURS", 70)
    np.testing.assert_array_equal(occupied_probability(draws, xy, 0.5), whole)


def test_bounds_come_with_the_same_answers_chain_by_chain() -> None:
    run = make_run(n_draws=60)
    xy = np.vstack((random_points(6, 40), [[1e3, 0.0]]))
    found = run.query(xy, 0.3, interval=True)
    np.testing.assert_array_equal(found.probability, run.query(xy, 0.3))
    assert found._fields == ("probability", "low", "high", "ess", "rhat", "seen")
    assert np.isnan([column[-1] for column in found[:5]]).all()
    assert not found.seen[-1]
    assert (found.low[:-1] <= found.probability[:-1]).all()
    assert (found.probability[:-1] <= found.high[:-1]).all()
    shuffled = np.argsort(run.chain, kind="stable")  # draws of a chain in their order: nothing changes
    other = dataclasses.replace(
        run,
        draws=Draws.from_colorings([run.draws[i] for i in shuffled]),
        chain=run.chain[shuffled],
        functionals={name: values[shuffled] for name, values in run.functionals.items()},
        probe_black=run.probe_black[shuffled],
    )
    np.testing.assert_array_equal(other.query(xy, 0.3, interval=True), found)
    paths = [[[0.0, 0.0], [0.5, 0.5]], [[0.0, 0.0], [1e3, 0.0]]]
    bounded = run.paths(paths, 0.1, interval=True)
    np.testing.assert_array_equal(bounded.probability, run.paths(paths, 0.1))
    assert bounded._fields == ("probability", "low", "high", "ess", "rhat")
    assert np.isnan(bounded.high).tolist() == [False, True]


@pytest.mark.parametrize("black", [False, True])
def test_without_edges_the_anchor_colours_all(black: bool) -> None:
    draws = Draws.from_colorings([Coloring.empty(WINDOW, black)])
    corners = [[WINDOW.x_min, WINDOW.y_min], [WINDOW.x_max, WINDOW.y_max], list(WINDOW.centre)]
    for square in (0.0, 3.0):
        np.testing.assert_array_equal(occupied_probability(draws, corners, square), [black] * 3)
    assert path_free(draws, corners, 0.3) == float(not black)


@pytest.mark.parametrize("radius", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("n_corners", [1, 2, 6])
def test_paths_agree_with_shapely(radius: float, n_corners: int) -> None:
    draws = random_draws(8, 60, scale=0.05)
    free = []
    for seed in range(10):
        path = random_points(seed, 1) + np.cumsum(np.random.default_rng(seed).normal(size=(n_corners, 2)), axis=0)
        path = np.clip(path, WINDOW[:2], WINDOW[2:])
        line = shapely.LineString(path) if n_corners > 1 else shapely.Point(path[0])
        expected = [shapely.distance(occupied_polygons(draw), line) for draw in draws]
        expected = [not (distance <= radius) for distance in expected]  # nan: nothing is occupied
        np.testing.assert_array_equal(path_free_in_draws(draws, path, radius), expected)
        assert path_free(draws, path, radius) == np.mean(expected)
        free.append(np.mean(expected))
    assert 0.05 < np.mean(free) < 0.95


def test_a_path_is_judged_jointly_not_point_by_point() -> None:
    window = Window(0.0, 0.0, 10.0, 10.0)
    left = shapely.box(2.0, 4.0, 3.0, 6.0)
    right = shapely.box(7.0, 4.0, 8.0, 6.0)
    from prf.model.coloring import from_polygons

    draws = Draws.from_colorings([from_polygons(left, window), from_polygons(right, window)])
    points = [[2.5, 5.0], [7.5, 5.0]]
    np.testing.assert_array_equal(occupied_probability(draws, points), [0.5, 0.5])
    assert path_free(draws, [[1.0, 5.0], [9.0, 5.0]], 0.2) == 0.0
    assert path_free(draws, [[1.0, 5.0], [5.0, 5.0]], 0.2) == 0.5
    assert path_free(draws, [[2.5, 5.0]], 0.2) == 0.5


def test_the_piece_of_a_leg_that_most_draws_block_is_found() -> None:
    """A post on a leg of seven metres in every second draw, another in every third, and none elsewhere."""
    posts = [room_with(*[box for box, n in POSTS if k % n == 0]) for k in range(60)]
    way = np.array([[1.0, 2.0], [1.0, 3.0], [8.5, 3.0]])
    piece, p_free = blocking_piece(Draws.from_colorings(posts), way, 0.2)
    assert p_free == 0.5
    assert np.hypot(*(piece[1] - piece[0])) <= PIECE + 1e-9
    assert piece[0, 0] <= 3.2 < 3.3 <= piece[1, 0]
    assert path_free(Draws.from_colorings(posts), way, 0.2) < 0.5


def test_legs_are_cut_where_they_are_long() -> None:
    way = [[0.0, 0.0], [0.5, 0.0], [0.5, 2.5]]
    found = cut_legs(np.array(way), 1.0)
    np.testing.assert_allclose(found, [[0, 0], [0.5, 0], [0.5, 2.5 / 3], [0.5, 5 / 3], [0.5, 2.5]])
    np.testing.assert_array_equal(cut_legs(np.array([[1.0, 2.0]]), 1.0), [[1.0, 2.0], [1.0, 2.0]])
    np.testing.assert_array_equal(cut_legs(np.array([[1.0, 2.0], [1.0, 2.0]]), 1.0), [[1.0, 2.0], [1.0, 2.0]])


def test_a_path_that_leaves_the_window_is_unknown() -> None:
    assert np.isnan(path_free(random_draws(1, 3), [[0.0, 0.0], [99.0, 0.0]], 0.1))


@pytest.mark.parametrize("square", [-1.0, np.nan, np.inf])
def test_wrong_values_are_named(square: float) -> None:
    draws = random_draws(1, 2)
    with pytest.raises(UsageError, match="square"):
        occupied_probability(draws, [[0.0, 0.0]], square)
    with pytest.raises(UsageError, match="radius"):
        path_free(draws, [[0.0, 0.0]], square)


def test_no_draw_and_no_path_are_named() -> None:
    empty = Draws.from_colorings([], WINDOW)
    with pytest.raises(InputError, match="no draws"):
        occupied_probability(empty, [[0.0, 0.0]])
    with pytest.raises(InputError, match="no draws"):
        path_free(empty, [[0.0, 0.0]], 0.1)
    with pytest.raises(InputError, match="at least one point"):
        path_free(random_draws(1, 2), [], 0.1)


@pytest.mark.parametrize("square", [0.0, 0.4])
def test_compiled_and_plain_python_agree(square: float, monkeypatch: pytest.MonkeyPatch) -> None:
    from prf.kernels.score import query

    draws, xy = random_draws(11, 3), random_points(12, 30)
    compiled = occupied_in_draws(draws, xy, square), path_free_in_draws(draws, xy[:4], square)
    for name in ("draws_mark_squares", "draws_clear_path"):
        monkeypatch.setattr(query, name, getattr(query, name).py_func)
    plain = occupied_in_draws(draws, xy, square), path_free_in_draws(draws, xy[:4], square)
    for a, b in zip(compiled, plain, strict=True):
        np.testing.assert_array_equal(a, b)


N_CHAINS, N_DRAWS, N_SERIES = 4, 256, 2000


CONVERGED = 1e6
"""Smallest effective size of a run whose every functional is known better than what is asked."""


def markov(seed: int, share: float, time: float, n_chains: int = N_CHAINS, n: int = N_SERIES) -> np.ndarray:
    """Return stationary binary chains (n_chains, n_draws, n) that forget their state after `time` draws on average."""
    rng = np.random.default_rng(seed)
    fresh = rng.random((n_chains, N_DRAWS, n)) < share
    keeps = rng.random((n_chains, N_DRAWS, n)) < np.exp(-1.0 / time)
    for draw in range(1, N_DRAWS):
        fresh[:, draw] = np.where(keeps[:, draw], fresh[:, draw - 1], fresh[:, draw])
    return fresh


def two_levels(seed: int, share: float, time: float, n_chains: int = N_CHAINS, n: int = N_SERIES) -> np.ndarray:
    """Return chains that flicker at each draw round a level, which changes slowly: few switches, many colours."""
    level = np.where(markov(seed, 0.5, time, n_chains, n), 0.3 * share, 1.7 * share)
    return np.random.default_rng([seed, 1]).random(level.shape) < level


def coverage(black: np.ndarray, low: np.ndarray, high: np.ndarray, share: float) -> float:
    varies = (black != black[:1, :1]).any(axis=(0, 1))
    return float(((low <= share) & (share <= high))[varies].mean())


@pytest.mark.parametrize("law", [markov, two_levels])
@pytest.mark.parametrize("time", [0.5, pytest.param(2.5, marks=pytest.mark.slow), 8.0, 25.0])
@pytest.mark.parametrize("share", [0.1, pytest.param(0.3, marks=pytest.mark.slow), 0.5])
def test_intervals_hold_as_often_as_promised(law, time: float, share: float) -> None:
    """Between 90 and 99.5 %: 2,000 series, coverages of 93 to 99 %, so a false alarm has p < 1e-3 in all of them."""
    black = law(1, share, time)
    found = estimates(black, CONVERGED)
    assert 0.90 < coverage(black, found.low, found.high, share) < 0.995


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_the_binomial_interval_of_all_draws_does_not(share: float) -> None:
    black = markov(1, share, 8.0)
    n, p = N_CHAINS * N_DRAWS, black.mean(axis=(0, 1))
    low, high = (stats.beta.ppf(level, n * p + 0.5, n * (1.0 - p) + 0.5) for level in (0.025, 0.975))
    assert coverage(black, low, high, share) < 0.6


def test_intervals_of_many_effective_draws_are_hardly_wider_than_needed() -> None:
    black = markov(2, 0.3, 0.5)
    found = estimates(black, CONVERGED)
    needed = 2.0 * 1.96 * np.sqrt(0.3 * 0.7 / (N_CHAINS * N_DRAWS) / np.tanh(1.0))
    assert needed < np.median(found.high - found.low) < 1.4 * needed


def test_no_answer_is_worth_much_more_than_what_the_run_knows_least() -> None:
    black = markov(2, 0.3, 0.5)
    known, unknown = estimates(black, CONVERGED), estimates(black, 10.0)
    assert (unknown.low <= known.low).all()
    assert (known.high <= unknown.high).all()
    of_forty_draws = 2.0 * 1.96 * np.sqrt(0.3 * 0.7 / 40.0)
    assert of_forty_draws < np.median(unknown.high - unknown.low) < 1.4 * of_forty_draws


@pytest.mark.parametrize("n_chains", [1, 2])
def test_fewer_chains(n_chains: int) -> None:
    black = markov(3, 0.3, 2.5, n_chains)
    found = estimates(black, CONVERGED)
    assert 0.90 < coverage(black, found.low, found.high, 0.3) < 0.995


def test_draws_that_are_all_equal_follow_the_rule_of_three() -> None:
    black = np.zeros((4, 500, 2), np.bool_)
    black[:, :, 1] = True
    found = estimates(black, 30.0)
    assert found.low.tolist() == [0.0, found.low[1]]
    assert found.high.tolist() == [found.high[0], 1.0]
    assert 1.0 - found.low[1] == pytest.approx(found.high[0])
    assert (1.0 - found.high[0]) ** 30 == pytest.approx(0.05)
    assert found.high[0] == pytest.approx(3.0 / 30.0, rel=0.06)
    assert found.ess.tolist() == [30.0, 30.0]
    assert found.rhat.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("n_black", [1, 2])
def test_stuck_chains_have_wide_intervals(n_black: int) -> None:
    black = np.zeros((4, 500, 1), np.bool_)
    black[:n_black] = True
    found = estimates(black, 1000.0)
    assert found.ess[0] < 5.0
    assert found.rhat[0] == np.inf
    assert found.low[0] == 0.0
    assert found.high[0] > 0.75


def test_a_colour_of_one_short_visit_may_have_no_probability() -> None:
    black = markov(8, 0.5, 1.0, n=2)
    black[:, :, 0] = False
    black[2, 100, 0] = True
    found = estimates(black, CONVERGED)
    assert found.low[0] == 0.0 < found.high[0] < 0.02
    assert 0.3 < found.low[1] < 0.5 < found.high[1] < 0.7


def test_too_few_draws_leave_everything_open() -> None:
    found = estimates(np.ones((4, 7, 3), np.bool_), 4.0)
    assert found.low.tolist() == [0.0] * 3
    assert found.high.tolist() == [1.0] * 3
    assert np.isnan(found.ess).all()


def test_batches_of_intervals_do_not_change_them(monkeypatch: pytest.MonkeyPatch) -> None:
    black = markov(4, 0.2, 10.0, n=50)
    whole = estimates(black, CONVERGED)
    monkeypatch.setattr("prf.results.estimate.MOST_VALUES", 3 * N_CHAINS * N_DRAWS)
    np.testing.assert_array_equal(estimates(black, CONVERGED), whole)
    assert estimates(black[:, :, :0], CONVERGED).low.shape == (0,)


def test_the_smallest_effective_size_is_that_of_colours_that_vary() -> None:
    colours = np.concatenate([markov(6, 0.3, 20.0, n=3), np.ones((4, N_DRAWS, 2), np.bool_)], axis=2)
    functionals = markov(7, 0.3, 60.0, n=1).astype(np.float64)
    assert smallest_ess(colours, functionals) == effective_size(colours)[:3].min()
    assert smallest_ess(colours[:, :, 3:], functionals) == max(effective_size(functionals)[0], 4.0)
    assert smallest_ess(colours[:, :, 3:], functionals * 0.0) == 4.0
    assert smallest_ess(colours[:, :7], functionals[:, :7]) == 4.0


def test_colours_near_a_question_bound_it() -> None:
    """The worst probe is a corner far off; one probe is constant and says nothing."""
    probe_xy, ess = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 3.0], [9.0, 0.0]]), np.array([4.0, 90.0, 300.0, np.nan])
    lines = [
        [[18.0, 0.0], [18.0, 9.0]],
        [[8.0, 0.0], [9.0, 1.0]],
        [[1.0, 1.0], [21.0, 1.0]],
        [[20.0, 6.0], [22.0, 9.0]],
    ]
    found = nearby_ess(shapely.linestrings(lines), 2.5, probe_xy, ess, 5.0)
    assert found.tolist() == [90.0, 5.0, 4.0, 5.0]
    assert nearby_ess(shapely.points([[20.0, 5.0]]), 2.5, probe_xy, ess, 5.0).tolist() == [300.0]
    assert nearby_ess(shapely.points([[20.0, 5.0]]), 2.5, probe_xy[:0], ess[:0], 5.0).tolist() == [5.0]


def test_probes_that_do_not_vary_say_nothing() -> None:
    colours = np.random.default_rng(4).random((4, 40, 3)) < 0.5
    colours[:, :, 2] = True
    found = probe_ess(colours)
    assert found[:2].tolist() == effective_size(colours)[:2].tolist()
    assert np.isnan(found[2])
    assert np.isnan(probe_ess(colours[:, :7])).all()


def test_a_free_corridor_is_bounded_by_what_is_known_beside_it() -> None:
    """One corner of the window is stuck in each chain at a colour of its own; beside the corridor a colour mixes."""
    maps = Draws.from_colorings([room_with()] * 400)
    black = np.column_stack([np.arange(400) % 4 < 2, np.random.default_rng(5).random(400) < 0.5])
    run = dataclasses.replace(make_run(n_draws=400), draws=maps, probe_black=black)
    corridor, corner = [[2.0, 3.0], [4.0, 3.0]], [[8.0, 5.0], [9.0, 5.0]]
    run = dataclasses.replace(run, probe_xy=np.array([[9.0, 5.2], [3.0, 4.0]]))
    found = run.paths([corridor, corner], 0.2, interval=True)
    assert found.probability.tolist() == [1.0, 1.0]
    assert found.ess[0] > 100.0
    assert found.ess[1] == run.smallest_ess < 5.0
    assert found.low[0] > 0.97
    assert found.low[1] < 0.6
    points = run.query([[3.0, 3.0], [9.0, 4.5], [6.0, 1.0]], interval=True)
    assert points.ess.tolist() == [found.ess[0], run.smallest_ess, run.smallest_ess]


def test_draws_are_sorted_by_chain_and_the_oldest_of_a_longer_one_left_out() -> None:
    chain = np.array([1, 0, 1, 0, 1], np.int32)
    np.testing.assert_array_equal(by_chain(np.arange(5), chain), [[1, 3], [2, 4]])
