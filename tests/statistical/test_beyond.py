"""Sensors that look out of the window: what they read beyond it is evidence about the world there, not inside.

The field in a sub-window is the field there, so a crop of a large window has a right answer: what the large one says.
And the truth, cropped, is one more draw of the posterior in the crop.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy import stats

from prf.kernels import constants as c
from prf.model.coloring import Coloring, black_at_draws
from prf.model.coloring.polygons import from_polygons, occupied_polygons
from prf.model.ranges import make_poses, make_rays
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import Window
from prf.sampler import Ensemble
from prf.sampler import target as targets
from prf.sampler.target import Execution, LaserData, SonarData, Target, laser_data
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance
from tests.reference.beams import Sensor, draw_readings, impacts
from tests.reference.slow_sonar import Cone, Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import draw_white, model_of
from tests.statistical.images import Estimate, estimate
from tests.statistical.problems import N_BEAMS, N_CONES, N_SENSORS, RING, ROOM, SCALE, SENSOR, VIEW, Problem
from tests.statistical.sbc import Arm, Calibration, run_arm
from tests.statistical.ways import WAYS

Floats = NDArray[np.float64]

SEED = 20261123
CROP = Window(0.0, 0.0, 4.0, 4.0)
STEPS = 1_600_000
N_CHAINS = 4
PLACES = np.stack(np.meshgrid(*2 * [np.arange(0.375, 3.75, 0.25)]), axis=-1).reshape(-1, 2)
"""Middles of the cells of the crop but for the outermost."""
CONFIDENCE = 0.99
LIMIT = float(stats.norm.isf(0.5 * (1.0 - CONFIDENCE) / (len(PLACES) + 1)))
"""Right samplers exceed it somewhere once in a hundred seeds."""
FLOOR = 0.02
"""Added to the Monte Carlo errors: the world outside tells a little of a field that hangs together."""

HALL = Window(-4.0, -4.0, 8.0, 8.0)
POST = shapely.box(2.2, 1.7, 2.6, 2.1)
"""In the crop, 1.4 m from its border."""
OPEN = shapely.distance(shapely.points(PLACES), POST) > 0.5
"""Places round which nothing stands."""


def walls(near: float, far: float) -> shapely.Geometry:
    """A square room round the crop."""
    return shapely.box(-far, -far, 4.0 + far, 4.0 + far) - shapely.box(-near, -near, 4.0 + near, 4.0 + near)


def hall_of_beams() -> LaserData:
    """Three scans of 48 beams, whose walls stand three metres outside the crop.

    None of them misses: only who knows of a wall outside can tell a miss from a free way.
    """
    rng, place = np.random.default_rng(SEED), np.array([[1.2, 1.4], [2.9, 2.8], [1.3, 2.9]])
    origin, angle = np.repeat(place, 48, axis=0), np.tile(2.0 * np.pi / 48 * (np.arange(48) + 0.3), 3)
    world = from_polygons(walls(3.0, 3.4) | POST, HALL)
    distance = impacts(world, origin, angle, 10.0)
    return laser_data(
        origin, angle, draw_readings(Sensor(10.0, outlier=0.0, miss=0.0), distance, rng), LaserModel(10.0)
    )


def hall_of_cones() -> SonarData:
    """Four rings of wide cones, and beside the border twenty looks along it at a pole outside."""
    ring, rng = Ring(2.6), np.random.default_rng(SEED)
    rings = ring_all_round(np.array([[1.2, 1.4], [2.9, 2.8], [1.3, 2.9], [3.0, 1.2]]), 12, 0.5, rng)
    beside = [Cone(0.3, 0.3, 0.5 * np.pi, 1.2)] * 20
    pole = shapely.box(-0.4, 2.2, -0.2, 2.4)
    return draw_data(from_polygons(walls(1.0, 1.4) | POST | pole, HALL), ring, [*rings, *beside], rng)


def target_of(kind: str, window: Window) -> Target:
    if kind == "laser":
        return Target(window, SCALE, hall_of_beams(), execution=Execution(resolution=0.25))
    return Target(window, SCALE, sonar=hall_of_cones(), execution=Execution(resolution=0.25))


def share_black(target: Target, seed: int) -> Estimate:
    """Probability that each place is black, and that any of the open ones is; and the Monte Carlo errors."""
    sampler = Ensemble(target, spawn_generators(seed, N_CHAINS))
    while sampler.step < STEPS:
        advance(sampler)
    found = sampler.sample()
    black = black_at_draws(found.draws, PLACES).astype(np.float64)
    black = np.column_stack([black, black[:, OPEN].max(axis=1)])
    return estimate(np.array([black[found.chain == k] for k in range(N_CHAINS)]), 0.0)


def apart(one: Estimate, other: Estimate) -> float:
    """Largest difference, in errors."""
    error = np.sqrt(one.error**2 + other.error**2 + FLOOR**2)
    return float((np.abs(one.mean - other.mean) / error).max())


def rays_uncensored(window: Window, model: LaserModel, *beams: Floats) -> Floats:
    """Readings beyond the window as if the map knew what stands there: nothing."""
    ray = make_rays(window, model, *beams)
    ray[:, c.RANGE] = np.where(beams[-1] < model.max_range, beams[-1], np.inf)
    return ray


def poses_uncensored(model: SonarModel, *cones: Floats | Window) -> Floats:
    return make_poses(model, *cones[:4])


@pytest.fixture
def uncensored(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(targets, "make_rays", rays_uncensored)
    monkeypatch.setattr(targets, "make_poses", poses_uncensored)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["laser", "sonar"])
def test_a_crop_agrees_with_the_large_window(kind: str) -> None:
    large, crop = (share_black(target_of(kind, window), seed) for window, seed in ((HALL, 1), (CROP, 2)))
    told = f"{kind}: {apart(large, crop):.2f} errors apart, R-hat {large.rhat:.3f}, {crop.rhat:.3f}"
    print(told)
    assert max(large.rhat, crop.rhat) < 1.1, told
    assert apart(large, crop) < LIMIT, told
    assert large.mean.max() > 0.5, "the post is there"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["laser", "sonar"])
@pytest.mark.usefixtures("uncensored")
def test_readings_that_are_not_censored_are_caught(kind: str) -> None:
    large, crop = (share_black(target_of(kind, window), seed) for window, seed in ((HALL, 1), (CROP, 2)))
    print(f"{kind}: {apart(large, crop):.2f} errors apart, black somewhere {large.mean[-1]:.2f}, {crop.mean[-1]:.2f}")
    assert apart(large, crop) > LIMIT


BLUNT = SENSOR._replace(noise=0.08)
"""Less so than elsewhere: what stands outside, within the noise of the border, may be read before it."""
AROUND = Window(*(side + shift for side, shift in zip(ROOM, (-4.0, -4.0, 4.0, 4.0), strict=True)))
"""No sensor of the room reaches its border."""


def world_round_the_room(rng: np.random.Generator) -> tuple[Coloring, Floats]:
    """A map of the prior all round the room, and sensors inside, all in white."""
    place = rng.uniform(ROOM[:2], ROOM[2:], (N_SENSORS, 2))
    return draw_white(SCALE, AROUND, place, rng), place


def cropped(world: Coloring) -> Coloring:
    return from_polygons(occupied_polygons(world) & shapely.box(*ROOM), ROOM)


def laser_that_looks_out(rng: np.random.Generator) -> Problem:
    world, place = world_round_the_room(rng)
    origin, angle = np.repeat(place, N_BEAMS, axis=0), rng.uniform(-np.pi, np.pi, N_SENSORS * N_BEAMS)
    readings = draw_readings(BLUNT, impacts(world, origin, angle, BLUNT.max), rng)
    data = laser_data(origin, angle, readings, model_of(BLUNT))
    return Problem(Target(ROOM, SCALE, data, execution=Execution(resolution=0.25)), cropped(world))


def sonar_that_looks_out(rng: np.random.Generator) -> Problem:
    world, place = world_round_the_room(rng)
    data = draw_data(world, RING, ring_all_round(place, N_CONES, VIEW, rng), rng)
    return Problem(Target(ROOM, SCALE, sonar=data, execution=Execution(resolution=0.25)), cropped(world))


LOOKING_OUT = {"laser": laser_that_looks_out, "sonar": sonar_that_looks_out}


def ranks(kind: str, n_worlds: int) -> Calibration:
    found = run_arm(Arm(f"{kind} that looks out", LOOKING_OUT[kind], WAYS["plain"]), n_worlds, SEED, 1)
    print(found.words())
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", LOOKING_OUT)
def test_the_cropped_truth_is_one_more_draw(kind: str) -> None:
    """Nine bands of 99 %: right samplers leave one of them with at most nine seeds of a hundred."""
    found = ranks(kind, 200)
    assert not found.outside()
    assert found.agreed > 0.9


@pytest.mark.slow
@pytest.mark.usefixtures("uncensored")
def test_ranks_without_censoring_are_not_uniform() -> None:
    assert ranks("laser", 100).outside()
