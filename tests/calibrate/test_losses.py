"""Likelihoods as functions of the parameters: the slow twins of the sensors, and gradients by differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prf.calibrate import laser, sonar
from prf.calibrate.fit import Problem, penalised
from prf.calibrate.gauss import spread
from prf.calibrate.laser import LaserProblem
from prf.calibrate.sonar import SonarProblem, model_at, sonar_problem
from prf.coloring import black_at
from prf.score.scene import features_seen, scene_of_coloring
from prf.sensors.laser import LaserModel
from prf.sensors.sonar import SonarModel, make_poses
from prf.window import Window
from tests.reference import slow_sonar
from tests.reference.beams import Sensor
from tests.reference.beams import log_likelihood as beam_log_likelihood
from tests.reference.slow_sonar import Cone, Ring
from tests.reference.sonar_worlds import model_of, random_office, ring_all_round

ROOM = Window(0.0, 0.0, 10.0, 8.0)


def sonar_world(seed: int, n_places: int = 12) -> tuple[SonarProblem, list[Cone], list[list[slow_sonar.Feature]]]:
    rng = np.random.default_rng(seed)
    coloring = random_office(ROOM, 8, 6, rng)
    places = rng.uniform(ROOM[:2], ROOM[2:], (n_places, 2))
    cones = ring_all_round(places[~black_at(coloring, places)], 6, 0.6, rng)
    readings = np.where(rng.random(len(cones)) < 0.3, math.inf, rng.uniform(0.05, 3.5, len(cones)))
    rows = np.array(cones)
    pose = make_poses(SonarModel(), rows[:, :2], rows[:, 2], rows[:, 3], readings)
    start, feature = features_seen(scene_of_coloring(coloring, 3.5), pose, 3.5)
    seen = [slow_sonar.features(coloring, cone, 3.5) for cone in cones]
    return sonar_problem(readings, start, feature, 3.5), cones, seen


def laser_world(seed: int, n: int = 400) -> LaserProblem:
    rng = np.random.default_rng(seed)
    distance = np.where(rng.random(n) < 0.2, math.inf, rng.uniform(0.01, 8.0, n))
    near = np.where(np.isfinite(distance), distance, 4.0) + 0.05 * rng.normal(size=n)
    reading = np.where(rng.random(n) < 0.5, np.abs(near), rng.uniform(0.0, 8.0, n))
    return LaserProblem(np.where((rng.random(n) < 0.15) | (reading >= 8.0), math.inf, reading), distance, 8.0)


def some_points(problem: Problem, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    family = problem.family
    return [family.default, *(family.default + family.width * rng.normal(size=len(family.default)) for _ in range(4))]


def ring_of(model: SonarModel) -> Ring:
    ring = Ring(
        model.max_range,
        model.noise,
        model.noise_relative,
        (model.corner_bias, model.corner_distance),
        (model.surface_bias, model.surface_distance, model.surface_oblique, model.surface_subtended),
        model.uniform_probability,
        model.short_probability,
        model.short_length,
    )
    assert model_of(ring) == model
    return ring


def test_the_scale_of_the_fit_and_back() -> None:
    assert sonar.model_at(sonar.to_scale(SonarModel()), 3.5).to_array() == pytest.approx(SonarModel().to_array())
    blunt = LaserModel(9.0, 0.2, 0.03, 0.3, 0.1)
    assert laser.natural(laser.to_scale(blunt)) == pytest.approx([0.2, 0.03, 0.3, 0.1])


def test_sonar_losses_are_those_of_the_slow_twin() -> None:
    problem, _, seen = sonar_world(1)
    for theta in some_points(problem, 1):
        ring = ring_of(model_at(theta, 3.5))
        pairs = zip(seen, problem.reading.tolist(), strict=True)
        expected = -sum(slow_sonar.log_likelihood(ring, features, r) for features, r in pairs)
        assert problem.loss(theta, is_sharp=True)[0] == pytest.approx(expected, rel=1e-9)


def test_laser_losses_are_those_of_the_slow_twin() -> None:
    problem = laser_world(2)
    for theta in some_points(problem, 2):
        model = Sensor(8.0, *laser.natural(theta).tolist())
        expected = -sum(
            beam_log_likelihood(model, r, d)
            for r, d in zip(problem.reading.tolist(), problem.distance.tolist(), strict=True)
        )
        assert problem.loss(theta, is_sharp=True)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("problem", [sonar_world(3)[0], laser_world(3)], ids=["sonar", "laser"])
def test_gradients_are_those_of_differences(problem: Problem) -> None:
    for theta in some_points(problem, 4):
        for function in (problem.loss, lambda at: penalised(problem, at)):
            found = function(theta)[1]
            steps = 1e-5 * np.eye(len(theta))
            expected = [(function(theta + h)[0] - function(theta - h)[0]) / 2e-5 for h in steps]
            assert found == pytest.approx(expected, rel=1e-5, abs=1e-3 * problem.n**0.5)


def test_rounded_kinks_are_close_to_the_model() -> None:
    for problem in (sonar_world(7)[0], laser_world(7)):
        for theta in some_points(problem, 7):
            sharp, smooth = problem.loss(theta, is_sharp=True)[0], problem.loss(theta)[0]
            assert abs(sharp - smooth) < 0.03 * problem.n
    depth = np.array([0.01, 1.0, 2.0, 50.0])
    smooth, first = spread(0.06, 0.03, depth, False)
    sharp, _ = spread(0.06, 0.03, depth, True)
    assert sharp.tolist() == pytest.approx([0.06, 0.06, 0.06, 1.5])
    assert smooth / sharp == pytest.approx([1.0, 1.0, 2.0 ** (1.0 / 16.0), 1.0], abs=1e-5)
    assert first == pytest.approx([1.0, 1.0, 0.5, 0.0], abs=1e-4)


def test_a_part_of_the_readings_is_a_problem_of_its_own() -> None:
    for problem in (sonar_world(5)[0], laser_world(5)):
        rows = np.arange(problem.n) % 3 == 0
        one, two = problem.select(rows), problem.select(~rows)
        theta = some_points(problem, 5)[1]
        assert one.n + two.n == problem.n
        assert one.loss(theta)[0] + two.loss(theta)[0] == pytest.approx(problem.loss(theta)[0])


def test_without_a_map_nothing_is_in_view() -> None:
    problem, _, _ = sonar_world(6)
    theta = problem.family.default
    expected = -sum(slow_sonar.log_likelihood(Ring(), [], r) for r in problem.reading.tolist())
    assert problem.without_map().loss(theta)[0] == pytest.approx(expected)
    beams = laser_world(6)
    returned = np.isfinite(beams.reading)
    expected = -returned.sum() * math.log(0.05 / 8.0) - (~returned).sum() * math.log(0.95)
    assert beams.without_map().loss(beams.family.default)[0] == pytest.approx(expected)
