"""Posteriors of poses by their moves: those that can be computed otherwise, and laws that moves must keep."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from prf.kernels.poses.state import BEND, MATCH, SHIFT, SLIP_REACH, WALK, WARP
from prf.model.coloring import Coloring, black_at
from prf.poses.model import PosePrior
from prf.poses.plane import compose, seen_from, wrapped
from prf.sampler.target import LaserData
from tests.reference.beams import Sensor
from tests.reference.pose_worlds import (
    BARE,
    BOTH,
    DRIVEN,
    LASER,
    ROOM,
    SLIPPING,
    UNLIKE,
    PoseWorld,
    Rig,
    begin,
    draw_pose_world,
)
from tests.statistical import mutants, pose_doors
from tests.statistical.pose_doors import sample_poses
from tests.statistical.pose_trials import trials

pytestmark = pytest.mark.slow

SEED = 20261123
Floats = NDArray[np.float64]
BLUNT = Sensor(2.2, noise=0.15, outlier=0.2, miss=0.05)
ONE = Rig(n=1, noise=(0.12, 0.15), n_beams=8, sensor=BLUNT)
LIGHT = ONE._replace(sensor=BLUNT._replace(weight=0.3))
PAIR = Rig(n=2, noise=(0.12, 0.15), odometry=(0.2, 0.1, 0.1, 0.1), n_beams=6, sensor=BLUNT)
TIED = PAIR._replace(n=3, noise=None)
SURE = PAIR._replace(odometry=None, first=0.3)
LOOSE = PAIR._replace(slip=0.3), TIED._replace(slip=0.3)
N_BATCHES = 50
LIMIT = 5.0
"""By chance once in 130,000 of Student's law with 49 degrees of freedom; of the 1,700 numbers here once in 75."""


def log_likelihood(world: PoseWorld, poses: Floats) -> Floats:
    """Log density of the readings at poses (k, n, 3), as the laser is written down; -inf where a sensor is in black."""
    model, laser = world.model, world.target.laser
    assert laser is not None
    assert model.laser is not None
    total = np.zeros(len(poses))
    ends = world.coloring.segments().reshape(-1, 4)
    for owner, local, bearing, reading in zip(*model.laser, laser.readings.range, strict=True):
        pose = poses[:, owner]
        cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        origin = pose[:, :2] + np.column_stack(
            [cosine * local[0] - sine * local[1], sine * local[0] + cosine * local[1]]
        )
        distance = first_hits(ends, origin, pose[:, 2] + bearing, laser.model.max_range)
        total += laser.model.weight * beam_density(laser, float(reading), distance)
        total[black_at(world.coloring, origin)] = -np.inf
    return total


def first_hits(ends: Floats, origin: Floats, angle: Floats, reach: float) -> Floats:
    """Distance (k,) to the first edge that each ray meets within reach; inf for none."""
    ux, uy = np.cos(angle), np.sin(angle)
    found = np.full(len(origin), np.inf)
    for ax, ay, bx, by in ends:
        across = ux * (by - ay) - uy * (bx - ax)
        t = ((ax - origin[:, 0]) * (by - ay) - (ay - origin[:, 1]) * (bx - ax)) / across
        s = ((ax - origin[:, 0]) * uy - (ay - origin[:, 1]) * ux) / across
        met = (t > 0.0) & (t < reach) & (s >= 0.0) & (s <= 1.0)
        found = np.where(met, np.minimum(found, t), found)
    return found


def beam_density(laser: LaserData, reading: float, distance: Floats) -> Floats:
    """Log density of one reading at distances (k,), by docs/sensor-models.md."""
    model = laser.model
    hit = 1.0 - model.outlier_probability - model.miss_probability
    s = np.maximum(model.noise, model.noise_relative * np.where(np.isfinite(distance), distance, 0.0))
    with np.errstate(invalid="ignore"):
        positive = stats.norm.cdf(distance / s)
        if np.isfinite(reading):
            density = np.where(np.isfinite(distance), hit * stats.norm.pdf(reading, distance, s) / positive, 0.0)
            return np.log(density + model.outlier_probability / model.max_range)
        beyond = stats.norm.cdf((distance - model.max_range) / s) / positive
    return np.log(model.miss_probability + hit * np.where(np.isfinite(distance), beyond, 1.0))


def features(poses: Floats, given: Floats) -> Floats:
    """Offsets of poses (k, n, 3) from the given ones, their products, and quantiles' indicators, flat."""
    offset = poses - given
    offset[:, :, 2] = wrapped(offset[:, :, 2])
    flat = offset.reshape(len(offset), -1)
    products = flat[:, :, None] * flat[:, None, :]
    above = [(flat > level).astype(float) for level in (-0.15, -0.05, 0.1)]
    return np.hstack([flat, products[:, *np.triu_indices(flat.shape[1])], *above])


@cache
def known_world(rig: Rig, seed: int) -> tuple[PoseWorld, Floats, Floats]:
    """A world, the means of the features and their errors: draws of the prior weighted with the likelihood."""
    rng = np.random.default_rng([SEED, seed])
    world = draw_pose_world(rig, rng)
    prior = world.model.prior
    poses, log_weight = prior_draws(prior, 200_000, rng)
    log_weight += log_likelihood(world, poses)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    assert 1.0 / (weight**2).sum() > 500.0, "too few of the draws count"
    found = features(poses, prior.given)
    mean = weight @ found
    return world, mean, np.sqrt(weight**2 @ (found - mean) ** 2)


def prior_draws(prior: PosePrior, n: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draws (n, n_poses, 3) of the errors, or of the odometry alone; of what both say the log weight of the latter."""
    if prior.is_held:
        poses = [np.tile(prior.given[0], (n, 1))]
        for motion, spread in zip(prior.motion, prior.spread, strict=True):
            error, chance = spread * rng.standard_normal((n, 3)), rng.random((n, 1))
            error = np.where(chance < prior.slip, 5.0 * error, error)
            error = np.where(chance < 0.1 * prior.slip, carries(n, rng), error)
            poses.append(compose(poses[-1], motion + error))
        return np.stack(poses, axis=1), np.zeros(n)
    drawn = prior.given + prior.noise[:, [0, 0, 1]] * rng.standard_normal((n, *prior.given.shape))
    if not len(prior.motion):
        return drawn, np.zeros(n)
    error = seen_from(drawn[:, :-1], drawn[:, 1:]) - prior.motion
    error[:, :, 2] = wrapped(error[:, :, 2])
    normal, slipped = (stats.norm.pdf(error, 0.0, times * prior.spread).prod(axis=2) for times in (1.0, 5.0))
    away = np.hypot(error[:, :, 0], error[:, :, 1]) / SLIP_REACH
    carried = (1.0 + away**2) ** -1.5 / (2.0 * np.pi * SLIP_REACH) ** 2
    mixed = (1.0 - prior.slip) * normal + prior.slip * (0.9 * slipped + 0.1 * carried)
    return drawn, np.log(mixed).sum(axis=1)


def carries(n: int, rng: np.random.Generator) -> Floats:
    """Errors (n, 3) of steps in which the robot was carried: Cauchy's distribution of the plane, and any turn."""
    place = SLIP_REACH * rng.standard_normal((n, 2)) / np.abs(rng.standard_normal((n, 1)))
    return np.column_stack([place, rng.uniform(-np.pi, np.pi, n)])


def z_of_moves(rig: Rig, odds: dict[int, float], seed: int) -> Floats:
    """z-scores of the features' means by a chain of moves; of indicators only where both answers are likely."""
    world, mean, error = known_world(rig, seed)
    poses, accepted = sample_poses(world, odds, 10_000, 30, 0.08, np.random.default_rng([SEED, seed, 1]))
    assert (accepted[list(odds)] > 2000).all(), accepted
    batches = features(poses, world.model.prior.given).reshape(N_BATCHES, -1, len(mean)).mean(axis=1)
    both = np.hypot(error, batches.std(axis=0, ddof=1) / np.sqrt(N_BATCHES))
    n_plain = len(mean) - 3 * world.truth.size
    shown = (np.arange(len(mean)) < n_plain) | (mean * (1.0 - mean) > 0.02)
    shown &= both > 1e-12  # not the held pose
    return np.asarray((batches.mean(axis=0) - mean)[shown] / both[shown])


@pytest.mark.parametrize("seed", [0, 1, 4, 5])
@pytest.mark.parametrize(
    "odds", [{WALK: 1.0}, {MATCH: 1.0}, {WALK: 0.5, MATCH: 0.5}], ids=["walk", "match", "walk and match"]
)
def test_one_pose_on_a_known_map_has_its_posterior(odds: dict[int, float], seed: int) -> None:
    z = z_of_moves(ONE, odds, seed)
    assert len(z) > 10
    assert np.abs(z).max() < LIMIT, z


@pytest.mark.parametrize("odds", [{WALK: 1.0}, {WALK: 0.5, MATCH: 0.5}], ids=["walk", "walk and match"])
def test_beams_of_less_weight_say_less_of_a_pose(odds: dict[int, float]) -> None:
    """Matches alone stay for long in the tails of what so little fixes, where their normal density has hardly any."""
    z = z_of_moves(LIGHT, odds, 4)
    assert np.abs(z).max() < LIMIT, z
    heavy, light = (error_of(known_world(rig, 4)) for rig in (ONE, LIGHT))
    assert light > 1.2 * heavy


def error_of(known: tuple[PoseWorld, Floats, Floats]) -> float:
    """Posterior standard deviation of x, by the means of the features."""
    _, mean, _ = known
    return float(np.sqrt(mean[3] - mean[0] ** 2))


KNOWN = [
    *((rig, seed) for rig in (PAIR, TIED) for seed in (11, 12, 15)),
    (SURE, 11),
    *zip(LOOSE * 2, (13, 13, 28, 32), strict=True),
]
"""Rigs and worlds; those of slips are such in which a robot that slipped to where no move leads has little weight."""


@pytest.mark.parametrize(("rig", "seed"), KNOWN)
@pytest.mark.parametrize(
    "odds",
    [{MATCH: 0.3, SHIFT: 0.7}, {MATCH: 0.3, BEND: 0.7}, {WALK: 0.4, MATCH: 0.2, SHIFT: 0.2, BEND: 0.2}],
    ids=["shift", "bend", "all"],
)
def test_poses_with_odometry_on_a_known_map_have_their_posterior(rig: Rig, odds: dict[int, float], seed: int) -> None:
    """Shifts alone would keep two poses as far apart as they are, so that matches come between them."""
    z = z_of_moves(rig, odds, seed)
    assert len(z) > 25
    assert np.abs(z).max() < LIMIT, z


@pytest.mark.parametrize(
    "wrong", ["a step of the odometry forgotten", "errors of the given poses forgotten", "slips forgotten"]
)
def test_a_factor_forgotten_is_caught(wrong: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The chain has another prior than the draws."""

    def begin_wrong(world: PoseWorld):  # type: ignore[no-untyped-def]
        chain, turns = begin(world)
        if wrong.startswith("a step"):
            turns.state.weight[0] = 0.0
        elif wrong.startswith("slips"):
            turns.state.slip[:] = -np.inf
        else:
            turns.state.precision[:] *= 0.1
        return chain, turns

    monkeypatch.setattr(pose_doors, "begin", begin_wrong)
    rig, seed = (LOOSE[1], 13) if wrong.startswith("slips") else (PAIR, 12)
    assert np.abs(z_of_moves(rig, {WALK: 0.5, BEND: 0.5}, seed)).max() > 1.5 * LIMIT


@pytest.mark.parametrize("odds", [{MATCH: 1.0}, {WALK: 1.0}, {MATCH: 0.5, WARP: 0.5}], ids=["match", "walk", "warp"])
def test_a_heading_that_hardly_anything_holds_has_its_law(odds: dict[int, float]) -> None:
    """A normal error of 2.5 radians, cut at half a turn: proposals are drawn beyond."""
    free = BARE._replace(n=1, noise=(0.05, 2.5), n_beams=1)
    rng = np.random.default_rng([SEED, 30])
    world = draw_pose_world(free, rng)._replace(coloring=Coloring.empty(ROOM))
    poses, _ = sample_poses(world, odds, 20_000, 20, 0.5, rng)
    offset = wrapped(poses[:, 0, 2] - world.model.prior.given[0, 2])
    cut = stats.truncnorm(-np.pi / 2.5, np.pi / 2.5, scale=2.5)
    uniform = cut.cdf(offset).reshape(N_BATCHES, -1)
    for power in (1, 2, 3, 4):
        means = ((uniform - 0.5) ** power - (0.0 if power % 2 else 0.5**power / (power + 1))).mean(axis=1)
        assert abs(means.mean()) < LIMIT * means.std(ddof=1) / np.sqrt(N_BATCHES)


TRIALS = {
    "no readings": (BARE, 0.9, 4000),
    "laser": (LASER, 0.4, 4000),
    "a pose known better": (UNLIKE, 0.4, 4000),
    "odometry": (DRIVEN, 0.4, 4000),
    "slips": (SLIPPING, 0.4, 4000),
    "laser, sonar and odometry": (BOTH, 0.4, 2000),
}


@pytest.mark.parametrize("name", TRIALS)
def test_moves_keep_the_joint_law_of_map_poses_and_readings(name: str) -> None:
    rig, warps, n = TRIALS[name]
    z, accepted = trials(rig, n, SEED, warps)
    assert all(count > n // 20 for count in accepted.values()), accepted
    # 43 numbers at most, each beyond 4.5 by chance once in 147,000: a run in 3,400.
    assert max(abs(value) for value in z.values()) < 4.5, z


@pytest.mark.parametrize(
    ("mutant", "rig", "n", "warps"),
    [
        pytest.param(mutants.NO_JACOBIAN, "BARE", 6000, 0.9, id=mutants.NO_JACOBIAN.name),
        pytest.param(mutants.NO_DENSITY, "LASER", 3000, 0.01, id=mutants.NO_DENSITY.name),
        pytest.param(mutants.NO_NEIGHBOUR, "DRIVEN", 3000, 0.01, id=mutants.NO_NEIGHBOUR.name),
    ],
)
def test_the_joint_law_catches_the_mistake(
    mutant: mutants.Mutant, rig: str, n: int, warps: float, tmp_path: Path
) -> None:
    arguments = ("tests.statistical.pose_trials", rig, str(n), str(SEED), str(warps))
    found = mutants.run_check(tmp_path, mutant, *arguments, compiled=True)
    assert max(abs(z) for z in found["z"].values()) > 6.0, found["z"]
