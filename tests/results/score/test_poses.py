"""Poses of held-out scans integrated out: lattices of poses, certain poses as the limit, and errors that are found."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy import stats

from prf.model.coloring import Coloring, Draws, from_polygons
from prf.model.window import Window
from prf.readings import Readings
from prf.results.occupancy import OccupancyGrid, build_grid
from prf.results.score import DrawsMap, GridMap, HeldOut, OccupiedArea, PolygonMap, ScoredMap, hold_out, score
from tests.factories import grid_settings, score_settings

Floats = np.ndarray
WINDOW = Window(-2.0, -2.0, 9.0, 7.0)
BOX = (0.0, 0.0, 7.0, 5.0)
NOISE = (0.15, 0.04)
FLAT = 0.05 / 12.0


def room(*box: float) -> Coloring:
    return from_polygons(shapely.box(*WINDOW) - shapely.box(*box), WINDOW)


def to_wall(box: tuple[float, ...], origin: Floats, angle: Floats) -> Floats:
    """Return the distance from inside a box to its side."""
    u = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray((np.where(u > 0.0, np.array(box[2:]) - origin, np.array(box[:2]) - origin) / u).min(axis=-1))


def scans(n: int, n_beams: int, rng: np.random.Generator, errors: Floats) -> tuple[Readings, Readings]:
    """Return readings in the box at given poses, which are wrong by `errors` (n, 3), and at the true ones."""
    true = np.column_stack([rng.uniform(1.5, 5.5, n), rng.uniform(1.5, 3.5, n), rng.uniform(-3.0, 3.0, n)])
    turn, scan = np.tile(np.linspace(-2.0, 2.0, n_beams), n), np.repeat(np.arange(n), n_beams)
    at = np.repeat(true, n_beams, axis=0)
    distance = to_wall(BOX, at[:, :2], at[:, 2] + turn) + rng.normal(0.0, 0.05, len(turn))
    logs = []
    for poses in (true + errors, true):
        here = np.repeat(poses, n_beams, axis=0)
        logs.append(Readings.from_arrays(here[:, :2], here[:, 2] + turn, distance, scan=scan))
    return logs[0], logs[1]


def held(readings: Readings, noise: tuple[float, float] | None = NOISE) -> HeldOut:
    return hold_out(readings, score_settings(max_range=12.0, pose_noise=noise))


def grid_of(readings: Readings) -> OccupancyGrid:
    return build_grid(readings, None, grid_settings(max_range=12.0, window=WINDOW))[0]


def lattice(half: float, step: float) -> tuple[Floats, float]:
    """Return errors in units of the noise (k, 3), and the log of the volume of each."""
    axis = np.arange(-half, half + 1e-9, step)
    errors = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return errors, 3.0 * math.log(step)


def on_lattice(readings: Readings, log_density: object) -> float:
    """Return the log of one scan's density, integrated over a lattice; `log_density` takes origins and angles."""
    errors, volume = lattice(4.0, 0.25)
    origin, angle = readings.origin[0], readings.angle
    at = origin + errors[:, None, :2] * NOISE[0]
    turned = angle[0] + errors[:, 2, None] * NOISE[1] + (angle - angle[0])
    assert callable(log_density)
    found = log_density(np.broadcast_to(at, (*turned.shape, 2)), turned).sum(axis=1)
    found += stats.norm.logpdf(errors).sum(axis=1) + volume
    return float(np.logaddexp.reduce(found))


def in_box(readings: Readings, box: tuple[float, ...]) -> float:
    def log_density(origin: Floats, angle: Floats) -> Floats:
        inside = ((origin > box[:2]) & (origin < box[2:])).all(axis=-1)
        d = to_wall(box, origin, angle)
        return np.log(np.where(inside, 0.95 * stats.norm.pdf(readings.range, d, 0.05), 0.0) + FLAT)

    return on_lattice(readings, log_density)


@pytest.fixture(scope="module")
def one_scan() -> Readings:
    return scans(1, 9, np.random.default_rng(5), np.array([[0.1, -0.2, 0.03]]))[0]


def test_polygons_agree_with_a_lattice_of_poses(one_scan: Readings) -> None:
    boxes = [
        BOX,
        (0.0, 0.0, 7.1, 5.0),
        (0.05, -0.1, 7.0, 4.9),
        (6.0, 4.0, 7.0, 5.0),
    ]  # the sensor is in the last's wall
    values = np.array([in_box(one_scan, box) for box in boxes])
    assert values[3] == pytest.approx(9.0 * math.log(FLAT), abs=1e-3)
    run = DrawsMap(Draws.from_colorings([room(*box) for box in boxes]), None)
    found = score(run, held(one_scan), 1)
    assert found["beam_nll"] == pytest.approx(-(np.logaddexp.reduce(values) - math.log(4.0)) / 9.0, abs=0.02)
    assert (found["pose_draws"], found["pose_noise"]) == (4, list(NOISE))
    assert found["pose_ess"] >= 10.0
    assert math.isnan(found["rmse"])
    for box, expected in zip(boxes, values, strict=True):
        area = OccupiedArea(shapely.box(*WINDOW) - shapely.box(*box), WINDOW)
        several = [score(PolygonMap(area), held(one_scan), seed)["beam_nll"] for seed in range(4)]
        assert np.mean(several) == pytest.approx(-expected / 9.0, abs=0.015)  # 0.008 each, at 100 effective samples


def test_a_grid_agrees_with_a_lattice_of_poses(one_scan: Readings) -> None:
    rng = np.random.default_rng(3)
    scored = GridMap(grid_of(scans(30, 60, rng, np.zeros((30, 3)))[1]))

    def log_density(origin: Floats, angle: Floats) -> Floats:
        there = np.tile(one_scan.range, len(angle))
        moved = Readings.from_arrays(origin.reshape(-1, 2), angle.ravel(), there)
        return np.log(scored.predict(held(moved, None))[0]).reshape(angle.shape)

    expected = -on_lattice(one_scan, log_density) / 9.0
    assert score(scored, held(one_scan), 1)["beam_nll"] == pytest.approx(expected, abs=0.02)


def maps_of_the_box(readings: Readings) -> list[ScoredMap]:
    coloring = room(*BOX)
    area = OccupiedArea(shapely.box(*WINDOW) - shapely.box(*BOX), None)
    return [DrawsMap(Draws.from_colorings([coloring]), coloring), PolygonMap(area), GridMap(grid_of(readings))]


def test_small_noise_leaves_the_scores_of_one_map_as_they_are_and_large_errors_are_found() -> None:
    rng = np.random.default_rng(8)
    given, true = scans(8, 60, rng, rng.normal(size=(8, 3)) * [NOISE[0], NOISE[0], NOISE[1]])
    for scored in maps_of_the_box(scans(40, 60, rng, np.zeros((40, 3)))[1]):
        certain, wrong = score(scored, held(true, None), 1), score(scored, held(given, None), 1)
        still = score(scored, held(true, (1e-9, 1e-9)), 1)
        assert {name: still[name] for name in certain} == pytest.approx(certain, abs=1e-3, nan_ok=True)
        assert {*still} - {*certain} == {"pose_noise", "pose_draws", "pose_ess"}
        found = score(scored, held(given), 1)
        assert wrong["beam_nll"] > certain["beam_nll"] + 0.5
        assert found["beam_nll"] < certain["beam_nll"] + 0.2  # of 60 beams, some ten nats are spent on the pose
        assert found["within_0.2m"] >= certain["within_0.2m"] - 0.02
        assert found["brier"] < 0.5 * (wrong["brier"] + certain["brier"])


def test_poses_far_off_are_found() -> None:
    rng, noise = np.random.default_rng(9), np.array([0.6, 0.6, 0.2])
    given, true = scans(8, 60, rng, rng.normal(size=(8, 3)) * noise)
    scored = PolygonMap(OccupiedArea(shapely.box(*WINDOW) - shapely.box(*BOX), None))
    found, certain = score(scored, held(given, (0.6, 0.2)), 1), score(scored, held(true, None), 1)
    assert found["beam_nll"] < certain["beam_nll"] + 0.35
    assert found["within_0.2m"] >= certain["within_0.2m"] - 0.02


def test_a_beam_that_ends_beyond_the_window_is_so_at_every_pose() -> None:
    """A sensor near the border, in free space: moved outside it, readings inside are outliers, those beyond certain."""
    scored = PolygonMap(OccupiedArea(shapely.MultiPolygon(), WINDOW))
    readings = Readings.from_arrays([-1.9, 3.0], [0.0, *[math.pi] * 9], 6.0 + np.zeros(10))
    found = score(scored, held(readings), 1)
    assert found["n_censored"] == 9  # each of these has a probability of 1, but for outliers
    assert found["beam_nll"] == pytest.approx(-0.1 * math.log(FLAT), abs=0.02)
