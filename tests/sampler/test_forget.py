"""What remains of readings that are let go: the same likelihood about the walls of the draws, and free ground."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely
import shapely.affinity
from numpy.typing import NDArray

from prf.kernels.state.grid import make_grid
from prf.model.coloring import Coloring, Draws, from_polygons
from prf.model.ranges import unit_vectors
from prf.model.window import Window
from prf.poses.model import PosePrior
from prf.poses.posterior import Trajectory
from prf.readings import Readings
from prf.readings.ground import count_beams
from prf.results import RunData
from prf.sampler import forget
from prf.sampler.forget import forgetting
from prf.shell.errors import InputError
from tests.reference.beams import Sensor, draw_readings, impacts, log_likelihoods_in

WINDOW = Window(0.0, 0.0, 10.0, 8.0)
SENSOR = Sensor(20.0, noise=0.03, outlier=0.05, miss=0.02)
SEED = 20261128


def room(right: float = 9.0, door: float = 0.0, up: float = 0.0) -> Coloring:
    """A room whose right wall stands at `right`, with a door in it of this width; all of it displaced by `up`."""
    free = shapely.box(1.0, 1.0, right, 7.0).union(shapely.box(right, 4.0 - 0.5 * door, 9.8, 4.0 + 0.5 * door))
    return from_polygons(shapely.box(*WINDOW).difference(shapely.affinity.translate(free, 0.0, up)), WINDOW)


def beams(rng: np.random.Generator, n_scans: int = 12) -> Readings:
    origin = np.repeat(rng.uniform((2.0, 2.0), (8.0, 6.0), (n_scans, 2)), 180, axis=0)
    angle = np.tile(np.linspace(-np.pi, np.pi, 180, endpoint=False), n_scans)
    readings = draw_readings(SENSOR, impacts(room(), origin, angle, SENSOR.max), rng)
    return Readings.from_arrays(origin, angle, readings, scan=np.repeat(np.arange(n_scans), 180)).within(SENSOR.max)


def run_of(rng: np.random.Generator, n_draws: int = 40) -> RunData:
    """Draws that know where the right wall stands within 2 mm."""
    maps = [room(9.0 + off) for off in rng.normal(0.0, 0.002, n_draws).tolist()]
    model = {"noise": 0.03, "noise_relative": 0.0, "outlier_probability": 0.05, "miss_probability": 0.02}
    return RunData(
        manifest={"configuration": model},
        draws=Draws.from_colorings(maps, WINDOW),
        chain=np.zeros(n_draws, np.int32),
        step=np.arange(n_draws, dtype=np.int64),
        functionals={},
        laser=beams(rng),
    )


def posed_run(rng: np.random.Generator, spread: float, up: float, n_draws: int = 40) -> RunData:
    """Draws that know where the right wall stands within `spread`, and all of the map, with the poses, within `up`."""
    run = run_of(rng, n_draws)
    assert run.laser is not None
    ups = rng.normal(0.0, up, n_draws)
    maps = [room(9.0 + off, up=y) for off, y in zip(rng.normal(0.0, spread, n_draws), ups, strict=True)]
    scan, first = np.unique(run.laser.scan, return_index=True)
    given, steps = np.column_stack([run.laser.origin[first], np.zeros(len(scan))]), np.zeros((0, 3))
    draws = np.zeros((n_draws, len(scan), 3), np.float32)
    draws[:, :, 1] = ups[:, None]
    prior = PosePrior(given, np.tile([0.05, 0.01], (len(scan), 1)), steps, steps)
    owner = run.laser.scan.astype(np.int32)
    found = Trajectory(scan, np.full(len(scan), np.nan), given, draws, owner, chain=run.chain, prior=prior)
    return dataclasses.replace(run, draws=Draws.from_colorings(maps, WINDOW), trajectory=found)


def log_likelihood(readings: Readings, coloring: Coloring) -> float:
    own = log_likelihoods_in(coloring, SENSOR, readings.origin, readings.angle, readings.range)
    return float(readings.weight @ np.array(list(own)))


def profile(readings: Readings, offs: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the log likelihood loses as the right wall moves away from where the draws have it, nats."""
    return np.array([log_likelihood(readings, room(9.0 + off)) for off in offs]) - log_likelihood(readings, room())


@pytest.mark.slow
def test_a_wall_is_known_as_well_and_the_ground_as_free_as_before() -> None:
    """The slope and the curvature across the wall within a nat; a wall that is gone costs as much."""
    run = run_of(np.random.default_rng(SEED))
    assert run.laser is not None
    found, told = forgetting(run, run.laser)
    assert found.n_beams < 0.6 * run.laser.n_beams
    assert told["forgotten"]["n_kept"] == found.n_beams
    assert told["forgotten"]["nats"] < 0.5
    offs = np.array([-0.006, -0.003, 0.003, 0.006])
    whole, left = profile(run.laser, offs), profile(found, offs)
    np.testing.assert_allclose(left, whole, atol=1.0)
    np.testing.assert_allclose(profile(found, np.array([0.5])), profile(run.laser, np.array([0.5])), rtol=0.15)
    grid = make_grid(*WINDOW, 0.25)
    passes = [
        count_beams(grid, WINDOW, each.origin, each.angle, each.range, each.max_range)[0] for each in (run.laser, found)
    ]
    seen = passes[0] > 0
    assert (passes[1] >= np.minimum(passes[0], 2))[seen].mean() > 0.98


@pytest.mark.slow
def test_beams_that_are_dropped_alone_lose_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The control: those that stay at their own weight and reading hold the wall less."""
    run = run_of(np.random.default_rng(SEED))
    assert run.laser is not None
    found, _ = forgetting(run, run.laser)
    alone = dataclasses.replace(found, weight=np.ones(found.n_beams))
    off = np.array([-0.02, 0.02])
    assert (profile(alone, off) > 0.8 * profile(run.laser, off)).all()
    assert (np.abs(profile(found, off) - profile(run.laser, off)) < 0.1 * np.abs(profile(run.laser, off))).all()


def test_what_stands_still_beside_the_poses_is_settled() -> None:
    """Map and poses that move as a whole, by more than the noise, from draw to draw."""
    run = posed_run(np.random.default_rng(SEED), 0.002, 0.1)
    assert run.laser is not None
    assert forget.Evidence(run, run.placed().laser).hit.mean() > 0.8  # type: ignore[arg-type]
    assert forget.Evidence(dataclasses.replace(run, trajectory=None), run.laser).hit.mean() < 0.5


@pytest.mark.slow
def test_beams_at_fixed_poses_say_no_more_of_a_wall_than_draws_know() -> None:
    """Poses that are uncertain leave a wall less known than the noise of its many beams would."""
    spread = 0.01
    run = posed_run(np.random.default_rng(SEED), spread, 0.0, 100)
    assert run.laser is not None
    found, told = forgetting(run, run.laser)
    assert told["forgotten"]["n_poses"] == 12
    off = np.array([-2.0 * spread, 2.0 * spread])
    assert -5.0 < profile(found, off).mean() < -1.5  # two of theirs; beams on which draws differ say something besides
    assert (profile(run.laser, off) < -100.0).all()
    assert told["forgotten"]["nats"] < 0.5


def test_what_draws_do_not_agree_on_is_kept_for_what_it_is() -> None:
    """Beams to a wall that stands in half of the draws alone stand for themselves."""
    rng = np.random.default_rng(SEED)
    run = run_of(rng)
    maps = [room(9.0 if i % 4 < 2 else 8.9, door=2.0 * (i % 4 < 2)) for i in range(40)]
    run = dataclasses.replace(run, draws=Draws.from_colorings(maps, WINDOW))
    assert run.laser is not None
    evidence = forget.Evidence(run, run.laser)
    x, y = (run.laser.origin + run.laser.range[:, None] * unit_vectors(run.laser.angle)).T
    hits_it = (np.abs(x - 9.0) < 0.05) & (np.abs(y - 4.0) < 2.5)
    assert hits_it.sum() > 100
    assert not evidence.hit[hits_it].any()
    assert evidence.hit[~hits_it].mean() > 0.8


def test_runs_without_a_wall_or_with_few_draws() -> None:
    rng = np.random.default_rng(SEED)
    run = run_of(rng)
    assert run.laser is not None
    silent = dataclasses.replace(run.laser, range=np.full(run.laser.n_beams, np.inf))
    empty = dataclasses.replace(run, draws=Draws.from_colorings([Coloring.empty(WINDOW)] * 40, WINDOW), laser=silent)
    found, told = forgetting(empty, silent)
    assert found.n_beams < silent.n_beams
    assert found.weight.sum() == pytest.approx(silent.n_beams)
    assert told["forgotten"]["nats"] < 1e-6
    with pytest.raises(InputError, match="3 draws are too few"):
        forgetting(run_of(rng, 3), run.laser)


def test_forgetting_again_changes_little() -> None:
    """So many readings of a place stay, however often it is gone on from."""
    run = run_of(np.random.default_rng(SEED))
    assert run.laser is not None
    once, _ = forgetting(run, run.laser)
    again, _ = forgetting(dataclasses.replace(run, laser=once), once)
    assert 0.8 * once.n_beams <= again.n_beams <= once.n_beams
    offs = np.array([-0.006, 0.006])
    np.testing.assert_allclose(profile(again, offs), profile(run.laser, offs), atol=1.5)
