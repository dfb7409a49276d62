"""Sonar readings that are held out: the slow twin of the sensor, closed forms, and what three kinds of map share."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.kernels.readings.sonar_features import CORNER, KIND
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_at, from_polygons, occupied_polygons
from prf.model.window import Window
from prf.readings import Readings
from prf.results.occupancy import OccupancyGrid
from prf.results.score import DrawsMap, GridMap, HeldOutSonar, OccupiedArea, PolygonMap, hold_out_sonar, score
from prf.results.score.maps import contours_of
from prf.results.score.scene import features_seen, outline, scene_of_coloring, scene_of_region
from prf.shell.errors import ConfigError, InputError
from tests.factories import score_settings
from tests.reference import slow_sonar
from tests.reference.slow_score import cone_density
from tests.reference.slow_sonar import Cone, Feature, Ring, features
from tests.reference.sonar_worlds import model_of, random_office, ring_all_round
from tests.results.test_occupancy import random_grid

ROOM = Window(0.0, 0.0, 10.0, 8.0)
WALL = shapely.box(3.0, 0.0, 3.5, 8.0)
VIEW = 0.349
NOTHING = 0.2 / 3.5
"""Density of an outlier far from the short ones."""


def held(cones: list[Cone], readings: object, ring: Ring | None = None) -> HeldOutSonar:
    rows = np.array(cones)
    log = Readings.from_arrays(rows[:, :2], rows[:, 2], readings, cone=rows[:, 3])
    return hold_out_sonar(log, score_settings(sonar=model_of(ring or Ring())))


def draws_of(colorings: list[Coloring]) -> DrawsMap:
    return DrawsMap(Draws.from_colorings(colorings), colorings[0])


def map_of(coloring: Coloring) -> PolygonMap:
    return PolygonMap(OccupiedArea(occupied_polygons(coloring), coloring.window))


AHEAD = Cone(1.0, 4.0, 0.0, VIEW)
INSIDE = Cone(3.2, 4.0, 0.0, VIEW)


class TestOneWall:
    features = (Feature(2.0, math.pi / 2, VIEW, False),)

    @pytest.mark.parametrize("reading", [2.02, 1.0, math.inf, 9.0])
    def test_the_score_is_the_likelihood(self, reading: float) -> None:
        expected = -slow_sonar.log_likelihood(Ring(), [*self.features], reading if reading < 3.5 else math.inf)
        for scored in (draws_of([from_polygons(WALL, ROOM)]), PolygonMap(OccupiedArea(WALL, ROOM))):
            found = score(scored, None, sonar=held([AHEAD], [reading]))
            assert found["sonar_nll"] == pytest.approx(expected, rel=1e-12)

    def test_only_what_was_given_is_reported(self) -> None:
        found = score(PolygonMap(OccupiedArea(WALL, ROOM)), None, sonar=held([AHEAD, AHEAD], [2.0, math.inf]))
        assert [*found] == [
            "kind",
            "n_draws",
            "n_readings",
            "n_readings_outside",
            "n_readings_no_return",
            "sonar_nll",
            "sonar_sensor_occupied",
            "sonar_max_range",
        ]
        assert (found["n_readings"], found["n_readings_no_return"], found["sonar_max_range"]) == (2, 1, 3.5)

    def test_draws_are_averaged_before_the_logarithm_and_an_occupied_sensor_leaves_outliers(self) -> None:
        covering = shapely.box(0.5, 3.0, 1.5, 5.0)
        colorings = [from_polygons(area, ROOM) for area in (WALL, covering)]
        found = score(draws_of([*colorings, Coloring.empty(ROOM)]), None, sonar=held([AHEAD], [2.02]))
        wall = float(slow_sonar.density(Ring(), [*self.features], np.array([2.02]))[0])
        outlier = float(slow_sonar.density(Ring(), [], np.array([2.02]))[0])
        assert found["sonar_nll"] == pytest.approx(-math.log((wall + outlier + outlier) / 3.0), rel=1e-12)
        assert found["sonar_sensor_occupied"] == pytest.approx(1.0 / 3.0)
        assert outlier == pytest.approx(NOTHING, rel=0.1)

    def test_an_occupied_sensor_without_return(self) -> None:
        found = score(PolygonMap(OccupiedArea(WALL, None)), None, sonar=held([INSIDE], [math.inf]))
        assert found["sonar_nll"] == pytest.approx(-math.log(slow_sonar.mass_of_no_return(Ring(), [])))
        assert found["sonar_sensor_occupied"] == 1.0

    def test_sensors_outside_the_window_are_counted_and_left_out(self) -> None:
        found = score(
            PolygonMap(OccupiedArea(WALL, ROOM)), None, sonar=held([AHEAD, AHEAD._replace(x=-1.0)], [2.0, 2.0])
        )
        assert (found["n_readings"], found["n_readings_outside"]) == (1, 1)
        with pytest.raises(InputError, match="one frame"):
            score(PolygonMap(OccupiedArea(WALL, ROOM)), None, sonar=held([AHEAD._replace(x=-1.0)], [2.0]))


@pytest.mark.parametrize("view", [VIEW, 1.5])
def test_draws_agree_with_the_slow_twin(view: float) -> None:
    rng = np.random.default_rng(1)
    draws = exact_draws(0.4, ROOM, 4, rng)
    cones = ring_all_round(rng.uniform(ROOM[:2], ROOM[2:], (12, 2)), 5, view, rng)
    ranges = np.where(rng.random(len(cones)) < 0.3, math.inf, rng.uniform(0.1, 3.5, len(cones)))
    expected = np.zeros(len(cones))
    for draw in draws:
        black = black_at(draw, np.array(cones)[:, :2])
        for k, (cone, r) in enumerate(zip(cones, ranges.tolist(), strict=True)):
            seen = [] if black[k] else features(draw, cone, 3.5)
            expected[k] += math.exp(slow_sonar.log_likelihood(Ring(), seen, r)) / len(draws)
    found = DrawsMap(draws, None).predict_sonar(held(cones, ranges))[0][""]
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_draw_scores_as_its_map() -> None:
    """Windows and their borders are treated alike in every kind of map."""
    rng = np.random.default_rng(2)
    for coloring in [*exact_draws(0.5, ROOM, 5, rng), random_office(ROOM, 8, 6, rng)]:
        cones = ring_all_round(rng.uniform(ROOM[:2], ROOM[2:], (20, 2)), 4, 0.6, rng)
        readings = held(cones, rng.uniform(0.1, 4.5, len(cones)))
        (one, share), (many, other) = (
            scored.predict_sonar(readings) for scored in (map_of(coloring), draws_of([coloring, coloring]))
        )
        assert one[""] == pytest.approx(many[""], rel=1e-9)
        assert share == other


def test_features_of_many_cones_are_in_order() -> None:
    rng = np.random.default_rng(3)
    coloring = random_office(ROOM, 8, 6, rng)
    places = rng.uniform(ROOM[:2], ROOM[2:], (10, 2))
    cones = ring_all_round(places[~black_at(coloring, places)], 5, 0.7, rng)
    start, found = features_seen(scene_of_coloring(coloring, 3.5), held(cones, np.ones(len(cones))).pose, 3.5)
    assert start[-1] == len(found) > 20
    for k, cone in enumerate(cones):
        rows = found[start[k] : start[k + 1]]
        assert (np.diff(rows[:, 0]) >= 0.0).all()
        expected = features(coloring, cone, 3.5)
        assert rows[:, 0] == pytest.approx([f.depth for f in expected], rel=1e-9)
        assert (rows[:, KIND] == CORNER).sum() == sum(f.is_corner for f in expected)


class TestOutline:
    def test_walls_that_were_joined_have_no_corner_at_the_joint(self) -> None:
        area = shapely.union_all([shapely.box(0, 0, 2, 1), shapely.box(2, 0, 5, 1)])
        segments, corners = outline(area, None)
        assert len(segments) == 4
        assert sorted(corners.ravel().tolist()) == [0, 0, 1, 1, 2, 2, 3, 3]

    def test_a_corner_that_a_file_has_twice_is_one(self) -> None:
        ring = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (4.0, 4.0), (0.0, 4.0), (0.0, 0.0)]
        segments, corners = outline(shapely.Polygon(ring), None)
        assert sorted(np.hypot(*(segments[:, 2:] - segments[:, :2]).T)) == [4.0] * 4
        assert sorted(corners.ravel().tolist()) == [0, 0, 1, 1, 2, 2, 3, 3]

    def test_the_border_of_the_window_is_no_wall_and_has_no_corner(self) -> None:
        segments, corners = outline(WALL, ROOM)
        assert len(segments) == 2
        assert (corners == c.NONE).all()
        assert len(outline(WALL, None)[0]) == 4
        assert (outline(WALL, None)[1] >= 0).all()

    def test_holes_are_walls_and_nothing_has_none(self) -> None:
        assert len(outline(shapely.box(0, 0, 9, 9) - shapely.box(1, 1, 2, 2), None)[0]) == 8
        assert outline(shapely.MultiPolygon(), ROOM)[0].shape == (0, 4)

    def test_a_map_without_a_window_may_lie_anywhere(self) -> None:
        far = [AHEAD._replace(x=AHEAD.x + 1e3)]
        found = PolygonMap(OccupiedArea(WALL, None)).predict_sonar(held(far, [1.0]))[0][""]
        assert found == pytest.approx(slow_sonar.density(Ring(), [], np.array([1.0])))
        scene = scene_of_region(shapely.MultiPolygon(), None, np.array([[0.0, 0.0]]), 3.5)
        assert len(scene.edges.segments) == 0


def grid_of(occupancy: np.ndarray, side: float = 0.1) -> OccupancyGrid:
    none = np.zeros(occupancy.shape, np.int32)
    return OccupancyGrid(occupancy.astype(np.float32), none, none, np.zeros(2), side)


class TestGrid:
    @pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
    @pytest.mark.parametrize("view", [0.002, VIEW, 1.2])
    def test_first_hits_agree_with_quadrature_and_sum_to_one(self, seed: int, view: float) -> None:
        grid = random_grid(seed)
        sparse = dataclasses.replace(grid, occupancy=grid.occupancy**6)
        ring = Ring(3.03, 0.05, 0.03)
        at = Cone(-0.6, 2.3, 0.5, view)
        some = np.array([0.005, 0.05, 0.4, 1.7, 3.0])
        expected, silent = cone_density(sparse, at, ring, some)
        found = GridMap(sparse).predict_sonar(held([at] * 6, [*some, math.inf], ring))[0]["first_hit"]
        np.testing.assert_allclose(found, [*expected, silent], rtol=1e-8)
        r = np.linspace(0.0, ring.max, 40_001)[:-1] + 0.5 * ring.max / 40_000
        dense = GridMap(sparse).predict_sonar(held([at] * len(r), r, ring))[0]["first_hit"]
        assert dense.mean() * ring.max + silent == pytest.approx(1.0, abs=1e-6)

    def test_one_wall(self) -> None:
        """A wall of certain cells across the view, all else free: both ways give nearly what the wall itself gives."""
        occupancy = np.full((80, 100), 0.001)
        occupancy[:, 30:35] = 0.999
        density, share_occupied = GridMap(grid_of(occupancy)).predict_sonar(held([AHEAD] * 2, [2.02, math.inf]))
        wall = [Feature(2.0, math.pi / 2, VIEW, False)]
        expected = slow_sonar.density(Ring(), wall, np.array([2.02]))[0]
        assert density["contours"][0] == pytest.approx(expected, rel=1e-3)
        assert 0.5 * expected < density["first_hit"][0] < expected
        assert share_occupied == 0.0

    def test_the_better_way_is_the_score_and_both_are_reported(self) -> None:
        occupancy = np.full((80, 100), 0.02)
        occupancy[:, 30:35] = 0.9
        for readings in ([2.03], [0.5], [math.inf]):
            found = score(GridMap(grid_of(occupancy)), None, sonar=held([AHEAD], readings))
            assert found["sonar_nll"] == min(found["sonar_nll_contours"], found["sonar_nll_first_hit"])

    def test_contours_straighten_staircases_and_keep_straight_walls(self) -> None:
        rows, columns = np.mgrid[:40, :40]
        slant = contours_of(grid_of(np.where(rows > columns, 0.9, 0.1)))
        assert len(shapely.get_coordinates(slant)) < 12
        assert slant.area == pytest.approx(7.8, rel=0.05)
        assert contours_of(grid_of(np.where((columns > 10) & (columns < 20), 0.9, 0.5))).equals(
            shapely.box(1.1, 0.0, 2.0, 4.0)
        )
        assert contours_of(grid_of(np.full((3, 3), 0.5))).is_empty


class TestHoldOut:
    def log(self, **options: object) -> Readings:
        return Readings.from_arrays(np.ones((3, 2)), np.zeros(3), [1.0, 3.5, 2.0], **options)

    def test_readings_without_return_are_kept(self) -> None:
        cones = hold_out_sonar(self.log(), score_settings())
        assert cones.range.tolist() == [1.0, math.inf, 2.0]

    def test_the_cone_of_the_log_takes_precedence(self) -> None:
        for cone, expected in ((0.0, 0.5), (1.0, 1.0)):
            cones = hold_out_sonar(self.log(cone=cone), score_settings(sonar_cone=0.5))
            assert cones.pose[:, 4] == pytest.approx(math.tan(0.5 * expected))

    def test_what_cannot_be_scored(self) -> None:
        with pytest.raises(ConfigError, match="--sonar-cone"):
            hold_out_sonar(self.log(), score_settings(sonar_cone=4.0))
        with pytest.raises(InputError, match="narrower than pi"):
            hold_out_sonar(self.log(cone=3.5), score_settings())
        with pytest.raises(InputError):
            hold_out_sonar(self.log(), score_settings(scans="7:"))
