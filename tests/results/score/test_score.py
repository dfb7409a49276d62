"""Scores: closed forms, densities that integrate to one, slow twins, and what three kinds of map have in common."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from prf.model.coloring import Coloring, Draws, from_polygons, occupied_polygons
from prf.model.window import Window
from prf.readings import Readings
from prf.readings.counts import BeamCounts
from prf.results import PosteriorImage
from prf.results.occupancy import OccupancyGrid
from prf.results.score import (
    DrawsMap,
    GridMap,
    HeldOut,
    LabelledPoints,
    OccupiedArea,
    PolygonMap,
    classification_scores,
    draw_points,
    hold_out,
    ranking_area,
    score,
)
from prf.results.score.returns import Returns
from prf.results.score.scene import first_edges
from prf.results.score.score import point_scores
from prf.shell.cli.storage import spawn_generators
from prf.shell.errors import ConfigError, InputError
from tests.factories import WINDOW, random_draws, score_settings
from tests.reference.beams import impacts
from tests.reference.slow_score import grid_density, pair_count_area
from tests.results.test_occupancy import random_grid

ROOM = Window(0.0, 0.0, 10.0, 10.0)
WALL = shapely.box(7.0, 2.0, 7.5, 8.0)


def held(origin: object, angle: object, ranges: object, **options: float) -> HeldOut:
    return hold_out(Readings.from_arrays(origin, angle, ranges), score_settings(**{"max_range": 8.0, **options}))


def random_beams(seed: int, window: Window, n: int = 300, max_range: float = 12.0) -> HeldOut:
    rng = np.random.default_rng(seed)
    return held(
        rng.uniform(window[:2], window[2:], (n, 2)),
        rng.uniform(-4.0, 4.0, n),
        rng.uniform(0.1, max_range, n),
        max_range=max_range,
    )


def peak(r: float, d: float, s: float = 0.05) -> float:
    return float(stats.norm.pdf(r, d, s) / stats.norm.cdf(d / s))


class TestOneWall:
    def test_one_beam(self) -> None:
        beams = held([2.0, 5.0], [0.0], [5.02])
        coloring = from_polygons(WALL, ROOM)
        found = score(DrawsMap(Draws.from_colorings([coloring]), coloring), beams, 1)
        assert found["beam_nll"] == pytest.approx(-math.log(0.95 * peak(5.02, 5.0) + 0.05 / 8.0), rel=1e-12)
        assert (found["within_0.2m"], found["no_obstacle"]) == (1.0, 0.0)
        assert found["rmse"] == pytest.approx(0.02)
        assert (found["n_beams"], found["n_points"], found["n_draws"]) == (1, 3, 1)
        assert (found["auc"], found["brier"], found["nll"]) == (1.0, 0.0, pytest.approx(-math.log(0.999)))

    def test_draws_are_averaged_before_the_logarithm(self) -> None:
        walls = [WALL, shapely.box(6.0, 2.0, 7.5, 8.0), shapely.box(1.0, 4.0, 3.0, 6.0)]  # the last covers the sensor
        colorings = [*(from_polygons(wall, ROOM) for wall in walls), Coloring.empty(ROOM)]
        found = score(DrawsMap(Draws.from_colorings(colorings), colorings[1]), held([2.0, 5.0], [0.0], [5.02]), 1)
        flat = 0.05 / 8.0
        densities = [0.95 * peak(5.02, 5.0) + flat, 0.95 * peak(5.02, 4.0) + flat, flat, flat]
        assert found["beam_nll"] == pytest.approx(-math.log(np.mean(densities)), rel=1e-12)
        assert found["rmse"] == pytest.approx(1.02)
        assert found["sensor_occupied"] == 0.25

    def test_an_occupied_sensor_is_at_its_obstacle(self) -> None:
        found = score(PolygonMap(OccupiedArea(WALL, ROOM)), held([7.2, 5.0], [0.0], [2.0]), 1)
        assert found["beam_nll"] == pytest.approx(-math.log(0.05 / 8.0))
        assert (found["rmse"], found["sensor_occupied"]) == (2.0, 1.0)

    def test_a_beam_past_the_wall_meets_nothing(self) -> None:
        found = score(PolygonMap(OccupiedArea(WALL, ROOM)), held([2.0, 9.0], [0.0], [5.0]), 1)
        assert found["beam_nll"] == pytest.approx(-math.log(0.05 / 8.0))
        assert (found["within_0.2m"], found["no_obstacle"]) == (0.0, 1.0)
        assert math.isnan(found["rmse"])

    @pytest.mark.parametrize(("x", "occupied"), [(7.0, False), (2.0, False), (7.2, True)])
    def test_a_return_beyond_the_window_is_censored_at_its_border(self, x: float, occupied: bool) -> None:
        room = Window(0.0, 0.0, 7.6, 10.0)
        area, coloring = OccupiedArea(WALL, room), from_polygons(WALL, room)
        beams = held([x, 9.0 if x == 7.0 else 5.0], [0.0], [6.5], miss_probability=0.1, noise=0.3)
        m, d = 7.6 - x, {7.0: math.inf, 2.0: 5.0}.get(x, 0.0)
        beyond = float(d >= m) or stats.norm.cdf((d - m) / 0.3) / stats.norm.cdf(d / 0.3)
        mass = 0.05 * (1.0 - m / 8.0) + (0.0 if occupied else 0.1 + 0.85 * beyond)
        for scored in (PolygonMap(area), draws_of([coloring, coloring])):
            found = score(scored, beams, 1)
            assert found["beam_nll"] == pytest.approx(-math.log(mass), rel=1e-9)
            assert (found["n_beams"], found["n_censored"]) == (1, 1)
        assert score(PolygonMap(OccupiedArea(WALL, None)), beams, 1)["n_censored"] == 0

    def test_the_border_of_the_window_is_no_obstacle(self) -> None:
        area = OccupiedArea(shapely.box(7.0, 0.0, 10.0, 10.0), ROOM)
        beams = held([[2.0, 5.0], [2.0, 5.0]], [0.0, math.pi], [5.0, 2.0])
        for scored in (PolygonMap(area), draws_of([from_polygons(area.region, ROOM)])):
            np.testing.assert_array_equal(scored.predict(beams)[1], [5.0, np.inf])
        free = PolygonMap(OccupiedArea(shapely.box(0.0, 0.0, 1.0, 10.0), None))
        np.testing.assert_array_equal(free.predict(beams)[1], [np.inf, 1.0])


def draws_of(colorings: list[Coloring]) -> DrawsMap:
    return DrawsMap(Draws.from_colorings(colorings), colorings[0])


@pytest.mark.parametrize("seed", range(3))
def test_first_edges_agree_with_shapely(seed: int) -> None:
    coloring, beams = random_draws(seed, 1)[0], random_beams(seed, WINDOW, 200)
    expected = impacts(coloring, beams.origin, np.arctan2(*beams.direction.T[::-1]), 12.0)
    found = first_edges(beams.rays(WINDOW), coloring.segments(), WINDOW)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_equal_draws_score_as_their_map(seed: int) -> None:
    coloring, beams = random_draws(seed, 1)[0], random_beams(seed, WINDOW, 100)
    one = score(PolygonMap(OccupiedArea(occupied_polygons(coloring), WINDOW)), beams, 3)
    many = score(DrawsMap(Draws.from_colorings([coloring] * 5), coloring), beams, 3)
    for name, value in one.items():
        if name not in ("kind", "n_draws") and "seen" not in name:
            assert many[name] == pytest.approx(value, rel=1e-9, nan_ok=True), name


class TestDensity:
    @pytest.mark.parametrize(("noise", "relative"), [(0.05, 0.0), (0.3, 0.0), (0.02, 0.1)])
    def test_returns_and_no_return_of_a_map_sum_to_one(self, noise: float, relative: float) -> None:
        area = PolygonMap(OccupiedArea(shapely.box(2.4, 4.0, 3.0, 6.0), None))
        r = np.linspace(0.0, 3.0, 60_001)[:-1] + 2.5e-5
        total = predicted_mass(area, r, 3.0, noise, relative)
        s = max(noise, relative * 0.4)
        silent = 0.95 * stats.norm.cdf((0.4 - 3.0) / s) / stats.norm.cdf(0.4 / s)
        assert total + silent == pytest.approx(1.0, abs=1e-6)

    @pytest.mark.parametrize(
        ("seed", "limit"),
        [
            (0, 5.03),
            pytest.param(1, 5.03, marks=pytest.mark.slow),
            (2, 5.53),
            pytest.param(3, 5.53, marks=pytest.mark.slow),
        ],
    )
    def test_grids_agree_with_quadrature_and_sum_to_one(self, seed: int, limit: float) -> None:
        grid = random_grid(seed)
        sparse = OccupancyGrid(grid.occupancy**4, grid.hits, grid.misses, grid.origin, grid.resolution)
        origin, angle, noise = np.array([-0.6, 2.3]), 0.5, 0.07
        some = np.array([0.01, 0.05, 0.4, 2.0, 3.33, limit - 0.03])
        beams = held(origin, np.full(6, angle), some, max_range=limit, noise=noise)
        reach = float(beams.rays(sparse.window)[0, 4])
        assert reach == pytest.approx(min(limit, 4.6 / math.cos(angle)))
        expected, beyond = grid_density(sparse, origin, angle, some, noise, 0.05, limit, reach)
        expected[some >= reach] = beyond
        np.testing.assert_allclose(GridMap(sparse).predict(beams)[0], expected, rtol=1e-9)
        r = np.linspace(0.0, reach, 60_001)[:-1] + 0.5 * reach / 60_000
        beams = held(origin, np.full(len(r), angle), r, max_range=limit, noise=noise)
        assert GridMap(sparse).predict(beams)[0].mean() * reach + beyond == pytest.approx(1.0, abs=1e-6)

    def test_a_reach_of_whole_bins_and_a_rounding_error_makes_no_bin_more(self) -> None:
        occupancy, none = np.full((4, 4), 0.5, np.float32), np.zeros((4, 4), np.int32)
        for k in range(1, 35):
            reach = 0.1 * k
            grid = OccupancyGrid(occupancy, none, none, np.array([reach - 4.0, 0.0]), 1.0)
            beams = held([0.0, 2.0], [0.0], [7.0])
            where = np.array([0.0, 2.0]), 0.0, np.empty(0)
            _, beyond = grid_density(grid, *where, 0.05, 0.05, 8.0, float(beams.rays(grid.window)[0, 4]))
            assert GridMap(grid).predict(beams)[0][0] == pytest.approx(beyond, rel=1e-6)


def predicted_mass(scored: PolygonMap, r: np.ndarray, limit: float, noise: float, relative: float) -> float:
    beams = held([2.0, 5.0], np.zeros(len(r)), r, max_range=limit, noise=noise, noise_relative=relative)
    return float(scored.predict(beams)[0].mean() * limit)


class TestGrid:
    def grid(self, p: float) -> GridMap:
        occupancy = np.zeros((20, 100), np.float32)
        occupancy[:, 50] = p
        none = np.zeros((20, 100), np.int32)
        return GridMap(OccupancyGrid(occupancy, none, none, np.zeros(2), 0.1))

    def test_the_first_likely_cell_is_the_obstacle(self) -> None:
        beams = held([1.0, 1.0], [0.0, math.pi], [4.1, 0.9])
        np.testing.assert_allclose(self.grid(0.6).predict(beams)[1], [4.05, np.inf])
        assert np.isinf(self.grid(0.5).predict(beams)[1][0])
        np.testing.assert_allclose(self.grid(1.0).predict(held([5.05, 1.0], [0.0], [1.0]))[1], [0.0])

    def test_one_wall(self) -> None:
        beams = held([1.0, 1.0], [0.0], [4.04])
        bin_mass = stats.norm.cdf((4.1 - 4.04) / 0.05) - stats.norm.cdf((4.0 - 4.04) / 0.05)
        expected = 0.95 * 0.6 * bin_mass / 0.1 + 0.05 / 8.0
        assert self.grid(0.6).predict(beams)[0][0] == pytest.approx(expected, rel=1e-6)

    @pytest.mark.parametrize("p", [0.0, 0.6, 1.0])
    def test_a_return_beyond_the_grid_is_censored_at_its_border(self, p: float) -> None:
        beams = held([1.0, 1.0], [math.pi, 0.0], [1.5, 7.0], noise=3.0)
        west, east = self.grid(p).predict(beams)[0]
        assert west == pytest.approx(0.95 + 0.05 * 7.0 / 8.0, rel=1e-6)
        assert score(self.grid(p), held([9.9, 1.0], [0.0], [0.35]), 1)["n_censored"] == 1
        assert 0.0 < east < 1.0, "a return within the grid"
        far = GridMap(self.grid(p).grid).predict(held([4.0, 1.0], [0.0], [7.0], noise=3.0))[0][0]
        beyond = stats.norm.cdf((1.05 - 6.0) / 3.0) / stats.norm.cdf(1.05 / 3.0)
        assert far == pytest.approx(0.95 * (1.0 - p + p * beyond) + 0.05 * 2.0 / 8.0, rel=1e-3)


class TestPoints:
    def test_points_of_a_beam(self) -> None:
        beams = held([1.0, 2.0], [0.0, math.pi / 2], [1.9, 7.0])
        points = draw_points(beams, np.random.default_rng(1))
        np.testing.assert_allclose(points.xy[:2], [[2.9, 2.0], [1.0, 9.0]])
        assert points.occupied.tolist() == [True, True, False, False, False]
        np.testing.assert_allclose(points.xy[2:, 0], 1.0)
        assert (points.xy[2:, 1] < 2.0 + 0.95 * 7.0).all()

    def test_free_points_fill_their_part_of_the_beam_evenly(self) -> None:
        beams = held(np.zeros((4000, 2)), np.zeros(4000), np.full(4000, 4.0))
        along = draw_points(beams, np.random.default_rng(2)).xy[4000:, 0]
        assert len(along) == 8000
        # False-alarm rate 1e-4.
        assert stats.kstest(along, "uniform", (0.0, 3.8)).pvalue > 1e-4
        assert stats.kstest(along, "uniform", (0.0, 4.0)).pvalue < 1e-4

    @given(st.integers(0, 1000), st.integers(1, 5))
    def test_ranking_area_counts_pairs(self, seed: int, n_levels: int) -> None:
        rng = np.random.default_rng(seed)
        values, positive = rng.integers(0, n_levels, 40) / n_levels, rng.random(40) < 0.4
        if 0 < positive.sum() < 40:
            assert ranking_area(values, positive) == pytest.approx(pair_count_area(values, positive))
        assert math.isnan(ranking_area(values, np.ones(40, np.bool_)))

    def test_a_weight_is_as_good_as_so_many_points(self) -> None:
        rng = np.random.default_rng(3)
        p, occupied, times = rng.integers(0, 5, 50) / 5.0, rng.random(50) < 0.4, rng.integers(1, 4, 50)
        found = classification_scores(p, occupied, times.astype(float))
        repeated = classification_scores(np.repeat(p, times), np.repeat(occupied, times))
        assert found == {name: pytest.approx(value) for name, value in repeated.items()}
        assert found["auc"] != pytest.approx(classification_scores(p, occupied)["auc"])

    def test_free_points_weigh_as_much_as_their_beam_passes_squares(self) -> None:
        beams = held([[2.0, 5.0], [2.0, 5.0]], [0.0, 0.1], [5.0, 1.5])
        points = draw_points(beams, np.random.default_rng(1))
        np.testing.assert_allclose(points.weight, [1.0, 1.0, *[0.95 * 5.0 / (0.2 * 2)] * 2])

    def test_a_run_is_asked_where_beams_end_and_where_it_is_black(self) -> None:
        coloring = from_polygons(WALL, ROOM)
        none = np.zeros((20, 20), np.int32)
        returns = Returns(0.1, 0.9, np.full((60, 60), 0.05), np.zeros(2), BeamCounts(none, none, np.zeros(2), 0.5))
        scored = DrawsMap(Draws.from_colorings([coloring]), coloring, returns=returns)
        beams = held([[2.0, 5.0], [2.0, 5.0]], [0.0, 0.1], [4.85, 1.5])
        found = score(scored, beams, 1)
        points = draw_points(beams, spawn_generators(1, 1)[0])
        for name, p in (("", scored.returned(points.xy, 0.2)), ("_map", scored.occupied(points.xy, 0.2))):
            assert found[f"nll{name}"] == classification_scores(p, points.occupied, points.weight)["nll"]
            assert found[f"nll{name}_unweighted"] == classification_scores(p, points.occupied)["nll"]
        assert found["nll"] < found["nll_map"]

    def test_probabilities_are_clipped_for_the_logarithm_only(self) -> None:
        found = classification_scores(np.array([0.0, 1.0, np.nan]), np.array([True, False, True]))
        assert found["nll"] == pytest.approx(-(2.0 * math.log(0.001) + math.log(0.5)) / 3.0)
        assert found["brier"] == pytest.approx(2.25 / 3.0)

    def test_every_kind_of_map_is_evaluated_on_the_same_square(self) -> None:
        xy = np.array([[6.91, 5.0], [6.89, 5.0], [6.91, 1.91], [6.89, 1.91], [99.0, 0.0]])
        cells = np.zeros((100, 100), np.float32)
        cells[20:80, 70:75] = 1.0
        none = np.zeros(cells.shape, np.int32)
        grid = GridMap(OccupancyGrid(cells, none, none, np.zeros(2), 0.1))
        for scored in (PolygonMap(OccupiedArea(WALL, ROOM)), draws_of([from_polygons(WALL, ROOM)])):
            np.testing.assert_array_equal(scored.occupied(xy, 0.2), [1.0, 0.0, 1.0, 0.0, np.nan])
            np.testing.assert_array_equal(scored.occupied(xy, 0.0), [0.0, 0.0, 0.0, 0.0, np.nan])
        assert PolygonMap(OccupiedArea(WALL, None)).occupied(xy, 0.2)[-1] == 0.0
        # The centres of the wall's cells begin at 7.05 and 2.05.
        xy = np.array([[6.96, 5.0], [6.94, 5.0], [6.96, 1.96], [6.96, 1.94], [99.0, 0.0]])
        np.testing.assert_allclose(grid.occupied(xy, 0.2), [1.0, 0.0, 1.0, 0.0, np.nan], atol=1e-9)
        np.testing.assert_array_equal(grid.occupied(xy, 0.0), [0.0, 0.0, 0.0, 0.0, np.nan])

    @pytest.mark.parametrize("square", [0.0, 0.2, 0.5])
    def test_the_square_has_the_requested_side(self, square: float) -> None:
        scored, beams = GridMap(random_grid(1, (60, 80))), random_beams(1, WINDOW)
        points = draw_points(beams.select(WINDOW.contains(beams.origin)), np.random.default_rng(1))
        found = point_scores(scored, points, square)
        p = scored.occupied(points.xy, square)
        assert found["brier"] == classification_scores(p, points.occupied, points.weight)["brier"]
        assert found["brier_unweighted"] == classification_scores(p, points.occupied)["brier"]
        assert score(scored, beams, 1, square=square)["square"] == square

    def test_unseen_points_are_marked(self) -> None:
        hits = np.zeros((100, 100), np.int32)
        hits[:, 30:] = 1  # the sensor's beam is seen from x = 3 on
        occupancy = np.where(hits > 0, 0.1, 0.5).astype(np.float32)
        grid = GridMap(OccupancyGrid(occupancy, hits, np.zeros_like(hits), np.zeros(2), 0.1))
        run = draws_of([from_polygons(WALL, ROOM)])
        assert run.image is None
        run.image = PosteriorImage(occupancy, occupancy, np.zeros(2), 0.1, hits > 0)
        points = LabelledPoints(np.array([[2.0, 5.0], [4.0, 5.0], [7.2, 5.0], [99.0, 5.0]]), np.arange(4) == 2)
        for scored in (grid, run):
            found = point_scores(scored, points, 0.0)
            known = classification_scores(scored.occupied(points.xy[1:3], 0.0), points.occupied[1:3])
            assert found["share_unseen"] == 0.5
            assert {name: found[f"{name}_seen"] for name in known} == known
            assert found["nll"] != found["nll_seen"]
        beyond = point_scores(grid, LabelledPoints(points.xy[:1], points.occupied[:1]), 0.2)
        assert beyond["share_unseen"] == 1.0
        assert math.isnan(beyond["nll_seen"])
        assert math.isnan(point_scores(draws_of([from_polygons(WALL, ROOM)]), points, 0.2)["share_unseen"])
        polygons = point_scores(PolygonMap(OccupiedArea(WALL, ROOM)), points, 0.2)
        assert (polygons["share_unseen"], polygons["nll_seen"]) == (0.0, polygons["nll"])

    def test_the_seed_decides_the_free_points(self) -> None:
        beams, scored = random_beams(1, WINDOW), GridMap(random_grid(1, (60, 80)))
        assert score(scored, beams, 1) == score(scored, beams, 1)
        assert score(scored, beams, 1)["nll"] != score(scored, beams, 2)["nll"]


class TestHoldOut:
    def test_beams_without_return_are_counted_and_left_out(self) -> None:
        beams = held([1.0, 1.0], [0.0, 1.0, 2.0], [1.0, 8.0, np.inf])
        assert (len(beams.range), beams.n_no_return) == (1, 2)

    def test_sensors_outside_the_window_are_counted_and_left_out(self) -> None:
        beams = held([[2.0, 5.0], [-2.0, 5.0]], [0.0, 0.0], [5.0, 5.0])
        found = score(PolygonMap(OccupiedArea(WALL, ROOM)), beams, 1)
        assert (found["n_beams"], found["n_outside"]) == (1, 1)
        assert score(PolygonMap(OccupiedArea(WALL, None)), beams, 1)["n_beams"] == 2
        with pytest.raises(InputError, match="one frame"):
            score(PolygonMap(OccupiedArea(WALL, ROOM)), held([-2.0, 5.0], [0.0], [5.0]), 1)

    def test_what_cannot_be_scored(self) -> None:
        with pytest.raises(InputError, match="no beam has a return"):
            held([1.0, 1.0], [0.0], [9.0])
        with pytest.raises(InputError, match="finite range"):
            hold_out(Readings.from_arrays([1.0, 1.0], [0.0], [np.inf]), score_settings())
        with pytest.raises(ConfigError, match="outlier-probability"):
            held([1.0, 1.0], [0.0], [1.0], outlier_probability=0.0)
        with pytest.raises(InputError, match="no draws"):
            DrawsMap(Draws.from_colorings([], ROOM), None)

    def test_a_run_without_a_best_map_lacks_its_scores_only(self) -> None:
        coloring = from_polygons(WALL, ROOM)
        found = score(DrawsMap(Draws.from_colorings([coloring]), None), held([2.0, 5.0], [0.0], [5.0]), 1)
        assert math.isnan(found["within_0.2m"])
        assert math.isfinite(found["beam_nll"])
