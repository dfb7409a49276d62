"""The simulated laser: distances by brute force, readings by the density that maps are inferred with."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prf.configuration import LaserPhysics
from prf.model.arak import exact_draws
from prf.model.window import Window
from prf.shell.errors import ArgumentError
from prf.simulate import World, office
from prf.simulate.sensors import bearings_of, cast, measure
from tests.reference.beams import Sensor, density, mass_of_no_return
from tests.reference.slow_laser import first_wall

ROOM = Window(0.0, 0.0, 10.0, 8.0)
SQUARE = np.array([(0.0, 0.0, 4.0, 0.0), (4.0, 0.0, 4.0, 3.0), (4.0, 3.0, 0.0, 3.0), (0.0, 3.0, 0.0, 0.0)])
"""A room of 4 x 3 m, seen from inside."""
FIELDS = (math.pi, 2.0 * math.pi, 1.0, 4.7)


def free_poses(world: World, n: int, rng: np.random.Generator) -> np.ndarray:
    xy = rng.uniform(world.window[:2], world.window[2:], (20 * n, 2))
    xy = xy[world.free_at(xy)][:n]
    return np.column_stack([xy, rng.uniform(-10.0, 10.0, len(xy))])


def slow_cast(walls: np.ndarray, poses: np.ndarray, physics: LaserPhysics) -> np.ndarray:
    return np.array(
        [[first_wall(walls, x, y, turn + bearing) for bearing in bearings_of(physics)] for x, y, turn in poses.tolist()]
    )


@pytest.mark.parametrize("field_of_view", FIELDS)
def test_distances_in_draws_from_the_prior_are_those_of_brute_force(field_of_view: float) -> None:
    rng = np.random.default_rng(1)
    physics = LaserPhysics(beams=37, field_of_view=field_of_view)
    for coloring in exact_draws(0.3, ROOM, 6, rng):
        world = World.from_coloring(coloring)
        poses = free_poses(world, 6, rng)
        found = cast(world.walls, poses, physics)
        np.testing.assert_allclose(found, slow_cast(world.walls, poses, physics), rtol=1e-9)


def test_distances_in_an_office_are_those_of_brute_force() -> None:
    world = office(15.0, 12.0, np.random.default_rng(2))
    poses = free_poses(world, 12, np.random.default_rng(3))
    physics = LaserPhysics(beams=61)
    found = cast(world.walls, poses, physics)
    np.testing.assert_allclose(found, slow_cast(world.walls, poses, physics), rtol=1e-9)


def test_no_beam_slips_out_of_a_closed_room() -> None:
    """Beams at the very corners, and along axes from round places."""
    rng = np.random.default_rng(4)
    corners = SQUARE[:, :2]
    for place in [(1.0, 1.0), (2.0, 1.5), *rng.uniform(0.2, 2.8, (50, 2)).tolist()]:
        for corner in corners:
            turn = math.atan2(corner[1] - place[1], corner[0] - place[0])
            pose = np.array([(*place, turn)])
            for beams in (8, 9, 181):
                found = cast(SQUARE, pose, LaserPhysics(beams=beams, field_of_view=2.0 * math.pi))
                assert np.isfinite(found).all()
                assert found.max() <= 5.0 + 1e-9


def test_walls_are_seen_from_their_free_side_only() -> None:
    outside = np.array([(-1.0, 1.5, 0.0)])
    assert np.isinf(cast(SQUARE[[3]], outside, LaserPhysics(beams=3))).all()
    assert cast(SQUARE[[3]][:, [2, 3, 0, 1]], outside, LaserPhysics(beams=3))[0, 1] == pytest.approx(1.0)


def test_bearings_follow_the_conventions_of_carmen() -> None:
    half = bearings_of(LaserPhysics(beams=180))
    assert (half[0], half[-1]) == pytest.approx((-math.pi / 2.0, math.pi / 2.0 - math.pi / 180.0))
    assert bearings_of(LaserPhysics(beams=181))[-1] == pytest.approx(math.pi / 2.0)
    full = LaserPhysics(beams=4, field_of_view=2.0 * math.pi)
    assert bearings_of(full).tolist() == pytest.approx([-math.pi, -math.pi / 2.0, 0.0, math.pi / 2.0])
    assert bearings_of(LaserPhysics(beams=3, field_of_view=1.0)).tolist() == pytest.approx([-0.5, 0.0, 0.5])


N = 200_000
BOUND = 4.5
"""Standard deviations; with some 250 bins over all cases a false alarm comes once in 600 runs of new numbers."""


def worst_z(readings: np.ndarray, sensor: Sensor, d: float) -> float:
    """Largest deviation, in standard deviations, of bins and of the mass of no return from the contract's density."""
    s = sensor.spread(min(d, sensor.max))
    steps = np.r_[-8.0, np.linspace(-3.0, 3.0, 25), 8.0]
    near = np.clip(d + s * steps, 0.0, sensor.max) if d < sensor.max else np.array([])
    edges = np.unique(np.concatenate([np.linspace(0.0, sensor.max, 12), near]))
    fine = np.linspace(edges[:-1], edges[1:], 401, axis=1)
    expected = np.array([np.trapezoid(density(sensor, row, d), row) for row in fine])
    found = np.histogram(readings[np.isfinite(readings)], edges)[0]
    expected = np.r_[expected, mass_of_no_return(sensor, d)]
    found = np.r_[found, np.isinf(readings).sum()]
    assert expected.sum() == pytest.approx(1.0, abs=1e-6)
    enough = expected * len(readings) > 10.0
    n, p = len(readings), expected[enough]
    return float(np.abs((found[enough] - n * p) / np.sqrt(n * p * (1.0 - p))).max())


CASES = [
    (Sensor(30.0), 4.0),
    (Sensor(30.0, 0.03, 0.01, 0.01, 0.02), 20.0),
    (Sensor(8.0, 0.2, 0.0, 0.1, 0.3), 7.9),
    (Sensor(8.0, 0.2, 0.0, 0.1, 0.05), 0.1),
    (Sensor(8.0, 0.05, 0.02, 0.05, 0.02), math.inf),
    (Sensor(8.0, 0.05, 0.02, 0.05, 0.02), 9.0),
]


def physics_of(sensor: Sensor) -> LaserPhysics:
    return LaserPhysics(
        max_range=sensor.max,
        noise=sensor.noise,
        noise_relative=sensor.relative,
        outlier_probability=sensor.outlier,
        miss_probability=sensor.miss,
    )


@pytest.mark.parametrize(("sensor", "d"), CASES)
def test_readings_follow_the_density_of_the_likelihood(sensor: Sensor, d: float) -> None:
    rng = np.random.default_rng(5)
    readings = measure(np.full(N, d), physics_of(sensor), rng)
    assert (readings > 0.0).all()
    assert not ((readings >= sensor.max) & np.isfinite(readings)).any()
    z = worst_z(readings, sensor, d)
    assert z < BOUND, f"z = {z:.2f} at seed 5"


@pytest.mark.parametrize("change", [{"noise": 0.032}, {"outlier_probability": 0.06}, {"miss_probability": 0.022}])
def test_a_slightly_wrong_scanner_does_not_follow_it(change: dict[str, float]) -> None:
    """Negative controls: the test above would see a scanner that is off by a tenth or a fifth."""
    sensor = Sensor(30.0, 0.03, 0.0)
    wrong = physics_of(sensor).replace(**change)
    assert worst_z(measure(np.full(N, 4.0), wrong, np.random.default_rng(6)), sensor, 4.0) > BOUND


def test_scanners_that_there_cannot_be_are_refused() -> None:
    for name, value in {"beams": 1, "max_range": math.inf, "noise": -1.0, "field_of_view": 7.0}.items():
        with pytest.raises(ArgumentError, match=f"^{name}"):
            LaserPhysics(**{name: value})  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="sum"):
        LaserPhysics(outlier_probability=0.6, miss_probability=0.6)
