"""`prf.calibrate`: likelihoods against slow twins, known parameters recovered, real readings, unusable ones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import stats

from benchmarks.real_sonar import ARENA_MAX_RANGE, ARENA_WINDOW, arena_plan
from prf.calibrate import (
    Calibrated,
    Family,
    calibrate_laser,
    calibrate_sonar,
    laser_density,
    loss_at,
    read_known_map,
    sonar_density,
)
from prf.configuration import Configuration
from prf.model.coloring import black_at
from prf.model.ranges import make_poses
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.output.export.cells import Raster
from prf.output.export.ros import ros_map
from prf.results.score import OccupiedArea, PolygonMap, hold_out_sonar, read_occupied_area, score
from prf.results.score.scene import features_seen, scene_of_coloring
from prf.shell.errors import ArgumentError, InputError
from tests.factories import score_settings
from tests.readings.sonar_sets import ARENA_POSITIONS, ARENA_WALLS, arena_readings
from tests.reference import slow_sonar
from tests.reference.beams import Sensor
from tests.reference.beams import log_likelihood as beam_log_likelihood
from tests.reference.known_worlds import TRUE_LASER, TRUE_RING, Known, laser_log, sonar_log
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import model_of, random_office, ring_all_round

ROOM = Window(0.0, 0.0, 10.0, 8.0)
LASER = Family(
    {"noise": 0.03, "noise_relative": 0.01, "outlier_probability": 0.05, "miss_probability": 0.02},
    ("outlier_probability", "miss_probability"),
)
SONAR_TRUTH = np.array(
    [
        TRUE_RING.noise,
        TRUE_RING.relative,
        *TRUE_RING.corner,
        *TRUE_RING.surface,
        TRUE_RING.uniform,
        TRUE_RING.short,
        TRUE_RING.short_length,
    ]
)
LASER_TRUTH = np.array([TRUE_LASER.noise, TRUE_LASER.relative, TRUE_LASER.outlier, TRUE_LASER.miss])


def sonar_fit(known: Known) -> Calibrated:
    return calibrate_sonar(known.readings, known.area, Configuration.of())


def laser_fit(known: Known) -> Calibrated:
    return calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0))


def z_scores(found: Calibrated, truth: np.ndarray) -> np.ndarray:
    z: np.ndarray = (found.value - truth) / found.error
    return z


def scored_loss(known: Known, model: SonarModel) -> float:
    """-log likelihood of all readings in the true map, as scores compute it."""
    cones = hold_out_sonar(known.readings, score_settings(sonar=model))
    found: dict[str, float] = score(PolygonMap(known.area), None, sonar=cones)
    return found["sonar_nll"] * known.readings.n_beams


def some_points(family: Family, seed: int) -> list[np.ndarray]:
    start, rng = family.to_scale(family.default), np.random.default_rng(seed)
    return [start, *(start + family.width() * rng.normal(size=len(start)) for _ in range(4))]


def test_sonar_losses_are_those_of_the_slow_twin() -> None:
    rng, family = np.random.default_rng(1), sonar_fit(sonar_log(5, 3)).family
    coloring = random_office(ROOM, 8, 6, rng)
    places = rng.uniform(ROOM[:2], ROOM[2:], (12, 2))
    cones = ring_all_round(places[~black_at(coloring, places)], 6, 0.6, rng)
    readings = np.where(rng.random(len(cones)) < 0.3, math.inf, rng.uniform(0.05, 3.5, len(cones)))
    rows = np.array(cones)
    pose = make_poses(SonarModel(), rows[:, :2], rows[:, 2], rows[:, 3], readings)
    start, feature = features_seen(scene_of_coloring(coloring, 3.5), pose, 3.5)
    there = np.arange(np.diff(start).max()) < np.diff(start)[:, None]
    padded = np.zeros((*there.shape, feature.shape[1]))
    padded[there] = feature
    density = sonar_density(readings, padded, there, 3.5)
    blind = sonar_density(readings, padded, np.zeros_like(there), 3.5)
    seen = [slow_sonar.features(coloring, cone, 3.5) for cone in cones]
    for theta in some_points(family, 1):
        v = list(family.natural(theta).values())
        ring = Ring(3.5, v[0], v[1], (v[2], v[3]), (v[4], v[5], v[6], v[7]), v[8], v[9], v[10])
        pairs = list(zip(seen, readings.tolist(), strict=True))
        expected = -sum(slow_sonar.log_likelihood(ring, features, r) for features, r in pairs)
        assert loss_at(family, density, theta) == pytest.approx(expected, rel=1e-9)
        expected = -sum(slow_sonar.log_likelihood(ring, [], r) for _, r in pairs)
        assert loss_at(family, blind, theta) == pytest.approx(expected, rel=1e-9)


def test_laser_losses_are_those_of_the_slow_twin() -> None:
    rng = np.random.default_rng(2)
    distance = np.where(rng.random(400) < 0.2, math.inf, rng.uniform(0.01, 8.0, 400))
    near = np.where(np.isfinite(distance), distance, 4.0) + 0.05 * rng.normal(size=400)
    reading = np.where(rng.random(400) < 0.5, np.abs(near), rng.uniform(0.0, 8.0, 400))
    reading = np.where((rng.random(400) < 0.15) | (reading >= 8.0), math.inf, reading)
    density = laser_density(reading, distance, np.full(400, 8.0), 8.0)
    for theta in some_points(LASER, 2):
        model = Sensor(8.0, *LASER.natural(theta).values())
        pairs = zip(reading.tolist(), distance.tolist(), strict=True)
        expected = -sum(beam_log_likelihood(model, r, d) for r, d in pairs)
        assert loss_at(LASER, density, theta) == pytest.approx(expected, rel=1e-9)
        assert abs(loss_at(LASER, density, theta, 16.0) - expected) < 0.03 * 400


@pytest.mark.slow
def test_a_sonar() -> None:
    """The truth is about as probable as the fit: twice the loss of log likelihood is chi-squared of 11 degrees."""
    known = sonar_log(1, 80)
    found = sonar_fit(known)
    model = SonarModel(3.5, **dict(zip(found.family.default, found.value.tolist(), strict=True)))
    best = scored_loss(known, model)
    assert found.loss == pytest.approx(best, rel=1e-9)
    # False-alarm rate 1e-3. The defaults are far beyond.
    most = 0.5 * stats.chi2.ppf(1.0 - 1e-3, 11)
    assert scored_loss(known, model_of(TRUE_RING)) - best < most
    assert found.loss_before - best > 10.0 * most
    assert found.converged
    assert found.loss < found.no_map
    assert (found.n_readings, found.n_scans) == (80 * 16, 80)


def test_a_laser() -> None:
    found = laser_fit(laser_log(2, 40))
    z = z_scores(found, LASER_TRUTH)
    assert np.abs(z).max() < 4.0, dict(zip(found.family.default, z, strict=True))
    assert found.informed.all()


@pytest.mark.slow
def test_readings_of_the_defaults_leave_the_defaults() -> None:
    """The negative control of the recovery."""
    found = sonar_fit(sonar_log(3, 40, Ring()))
    assert np.abs(z_scores(found, np.array(list(found.family.default.values())))).max() < 4.0


def test_few_readings_keep_what_they_do_not_show_at_its_default() -> None:
    """Three scans see hardly a corner: no parameter runs away, and the report marks which are the prior's."""
    found = sonar_fit(sonar_log(5, 3))
    assert np.isfinite(found.error).all()
    assert not found.informed.all()
    off = (found.theta - found.family.to_scale(found.family.default)) / found.family.width()
    assert np.abs(off).max() < 3.0


@pytest.mark.slow
def test_scores_over_many_worlds_are_standard_normal() -> None:
    """Mean and spread of z over 25 worlds: errors are neither too small nor too large, and nothing is biased."""
    n = 25
    scores = np.array([z_scores(sonar_fit(sonar_log(100 + seed, 150)), SONAR_TRUTH) for seed in range(n)])
    # Priors pull: each adds a bias of up to error / width in units of the error, so a wider band for the mean.
    assert np.abs(scores.mean(axis=0)).max() < 4.0 / np.sqrt(n) + 0.3, scores.mean(axis=0)
    low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], n) / n
    squares = (scores**2).mean(axis=0)
    assert squares.max() < high + 0.3**2, squares
    assert squares.min() > 0.8 * low, squares


@pytest.mark.slow
def test_laser_scores_over_many_worlds_are_standard_normal() -> None:
    n = 40
    scores = np.array([z_scores(laser_fit(laser_log(200 + seed, 40)), LASER_TRUTH) for seed in range(n)])
    assert np.abs(scores.mean(axis=0)).max() < 4.0 / np.sqrt(n) + 0.2, scores.mean(axis=0)
    low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], n) / n
    assert (scores**2).mean(axis=0).max() < high + 0.2**2
    assert (scores**2).mean(axis=0).min() > 0.8 * low


def test_the_plan_of_the_arena_has_its_walls_and_no_others(tmp_path: Path) -> None:
    area = read_occupied_area(arena_plan(tmp_path / "arena.geojson"))
    assert area.window == Window(*ARENA_WINDOW)
    inside = 2.1 * 0.84 + 1.68 * 0.84 + 0.84 * 0.42  # bottom, middle, top
    assert 2.9 * 2.9 - area.region.area == pytest.approx(inside - 0.42 * 0.02, abs=0.01)
    assert not shapely.contains_xy(area.region, 0.01 * np.array(ARENA_POSITIONS)).any()
    edge = area.region.boundary
    assert max(edge.distance(shapely.Point(wall.mean(axis=0))) for wall in ARENA_WALLS) < 0.011


@pytest.mark.slow
def test_what_some_places_show_helps_at_another(shared_data: Path, tmp_path: Path) -> None:
    area = read_occupied_area(arena_plan(tmp_path / "arena.geojson"))
    readings = arena_readings(shared_data / "prf/sonar/arena_known_map")
    found = calibrate_sonar(readings, area, Configuration.of(sonar_max_range=ARENA_MAX_RANGE, skip_scans="4:5"))
    assert (found.n_readings, found.n_in_view) == (720, 720)
    assert found.loss < found.no_map - 700
    assert np.isfinite(found.error).all()
    value = dict(zip(found.family.default, found.value.tolist(), strict=True))
    assert 0.03 < value["noise_relative"] < 0.06
    held_out = []
    for model in (SonarModel(ARENA_MAX_RANGE), SonarModel(ARENA_MAX_RANGE, **value)):
        cones = hold_out_sonar(readings, score_settings(sonar=model, scans="4:5"))
        held_out.append(score(PolygonMap(area), None, sonar=cones)["sonar_nll"])
    assert held_out[1] < held_out[0] - 0.4


def test_returns_from_beyond_the_window_are_no_outliers() -> None:
    """Half of a hall is known: walls of the other half return many beams."""
    known, window = laser_log(2, 200), Window(0.0, 0.0, 7.0, 10.0)
    area = OccupiedArea(known.area.region.intersection(shapely.box(*window)), window)
    found = calibrate_laser(known.readings, area, Configuration.of(max_range=8.0))
    assert np.abs(z_scores(found, LASER_TRUTH)).max() < 4.0


def test_sensors_beside_the_map_are_dropped_counted_or_refused(caplog: pytest.LogCaptureFixture) -> None:
    known = laser_log(1, 10)
    window = Window(0.0, 0.0, 7.0, 10.0)
    region = known.area.region.intersection(shapely.box(*window))
    part = calibrate_laser(known.readings, OccupiedArea(region, window), Configuration.of(max_range=8.0))
    assert part.n_outside == np.count_nonzero(known.readings.origin[:, 0] >= 7.0)
    assert part.n_readings + part.n_outside == known.readings.n_beams
    assert "dropped: their sensors are outside the map" in caplog.text
    with pytest.raises(InputError, match="none of 600 readings can be used"):
        calibrate_laser(
            known.readings, OccupiedArea(shapely.box(-1, -1, 20, 20), None), Configuration.of(max_range=8.0)
        )
    with pytest.raises(ArgumentError, match="max_range"):
        calibrate_laser(known.readings, known.area, Configuration.of(max_range=-1.0))


def test_a_map_of_ros(tmp_path: Path) -> None:
    occupied = np.zeros((20, 30))
    occupied[5:8, 10:20] = 1.0
    yaml, image, _ = ros_map(Raster(occupied, np.array([2.0, 1.0]), 0.1), None, "map.pgm")
    (tmp_path / "map.pgm").write_bytes(image)
    (tmp_path / "map.yaml").write_text(yaml)
    area = read_known_map(tmp_path / "map.yaml")
    assert area.window == pytest.approx((2.0, 1.0, 5.0, 3.0))
    assert area.region.bounds == pytest.approx((3.0, 1.5, 4.0, 1.8))
    yaml, image, _ = ros_map(Raster(0.0 * occupied, np.array([2.0, 1.0]), 0.1), None, "map.pgm")
    (tmp_path / "map.pgm").write_bytes(image)
    with pytest.raises(InputError, match="nothing is occupied"):
        read_known_map(tmp_path / "map.yaml")
