"""Worlds from the prior, readings from a sensor model: probabilities are the shares observed, and ranks are uniform."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import prf.sampler.tiles.rounds as schedule
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, black_at_draws
from prf.model.points import log_density
from prf.model.window import Window
from prf.sampler.target import Execution, PointData, SonarData, Target
from tests.reference.beams import Sensor
from tests.reference.slow_points import Flips, Normal, lattice, observe
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.reference.worlds import draw_world
from tests.statistical.ranks import rank_of
from tests.statistical.sbc import Calibration, World, calibrate, run_arm, standard_arm
from tests.statistical.ways import Stages, in_stages

SEED = 20050726
SCALE = 0.15
ROOM = Window(0.0, 0.0, 10.0, 10.0)
SENSOR = Sensor(8.0)
N_SENSORS, N_BEAMS, N_PROBES = 3, 40, 100
SONAR_SEED = 20260107
RING = Ring(5.0, surface=(3.0, 0.3, 6.0, 3.0))
"""Blunter than the defaults, so that many readings come from a wall."""
N_CONES, VIEW = 12, 0.5
LIMIT = 3.5
"""Five bins beyond it by chance: once in 430 for normal sums."""
STAGES: Stages = ((800_000, 1.05), (1_600_000, 1.05), (3_200_000, 1.2), (6_400_000, 1.2), (12_800_000, 1.2))
SONAR_STAGES: Stages = ((300_000, 1.1), (600_000, 1.1), (1_200_000, 1.2), (2_400_000, 1.2), (4_800_000, 1.2))
"""Sonar leaves more open, so chains agree sooner."""
Places = NDArray[np.float64]
Problem = tuple[Target, Coloring, int, Places]
"""A posterior, the map from which its readings were drawn, the seed of the chains, and random points."""


def laser_problem(number: int, scale: float = SCALE, tiles: int = 0) -> Problem:
    """`scale` is right by default."""
    world = draw_world(SCALE, ROOM, SENSOR, N_SENSORS, N_BEAMS, np.random.default_rng([SEED, number]))
    points = np.random.default_rng([SEED, number, 1]).uniform(ROOM[:2], ROOM[2:], (N_PROBES, 2))
    return (
        Target(ROOM, scale, world.data, execution=Execution(resolution=0.5, tiles=tiles)),
        world.coloring,
        SEED + number,
        points,
    )


def sonar_problem(number: int, change: Callable[[SonarData], SonarData] = lambda data: data) -> Problem:
    """`change` makes the readings that the sampler is given wrong."""
    rng = np.random.default_rng([SONAR_SEED, number])
    world = draw_sonar_world(SCALE, ROOM, RING, N_SENSORS, N_CONES, VIEW, rng)
    target = Target(ROOM, SCALE, sonar=change(world.data), execution=Execution(resolution=0.5))
    return target, world.coloring, SONAR_SEED + number, rng.uniform(ROOM[:2], ROOM[2:], (N_PROBES, 2))


def sampled(problem: Problem, stages: Stages, rungs: int = 1) -> tuple[World, Draws]:
    """Sample the posterior of one world, and ask for the colours of its points."""
    target, truth, seed, points = problem
    draws, rhat = in_stages(target, seed, stages, rungs)
    colours = black_at_draws(draws, points).mean(axis=0), black_at(truth, points)
    return World(np.empty(0, np.int64), rhat < 1.2, 0, *colours), draws


def shares_of(
    n_worlds: int, stages: Stages, make: Callable[[int], Problem] = laser_problem, rungs: int = 1
) -> tuple[Calibration, float]:
    """What came of two worlds at a time, and the largest |z| of the shares."""
    found = calibrate(lambda number: sampled(make(number), stages, rungs)[0], n_worlds)
    print(found.words())
    return found, float(np.abs(found.shares().z).max())


def seen_too_narrow(data: SonarData) -> SonarData:
    """Cones of 29 degrees taken for beams of 3: walls to the side of the axis are put on it."""
    readings = dataclasses.replace(data.readings, cone=np.full(data.readings.n_beams, 0.05))
    return dataclasses.replace(data, readings=readings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "stages"), [(laser_problem, STAGES), (sonar_problem, SONAR_STAGES)], ids=["laser", "sonar"]
)
def test_probabilities_are_the_shares_observed(make: Callable[[int], Problem], stages: Stages) -> None:
    found, worst = shares_of(40, stages, make)
    assert worst < LIMIT, found.words()
    assert (found.shares().n >= 100).all(), found.words()
    # Chains that do not mix would miss the shares, or hit them by luck: neither says anything about the sampler.
    assert found.agreed > 0.9, found.words()


@pytest.mark.slow
def test_probabilities_are_the_shares_observed_with_a_ladder() -> None:
    """Fewer worlds, each of which costs three times as much."""
    found, worst = shares_of(12, STAGES[:2], rungs=3)
    assert worst < LIMIT, found.words()
    assert found.agreed > 0.8, found.words()


@pytest.mark.slow
def test_probabilities_are_the_shares_observed_with_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schedule, "ROUND_LENGTHS", (64_000, 64_000))
    found, worst = shares_of(30, STAGES[:3], partial(laser_problem, tiles=5))
    assert worst < LIMIT, found.words()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "stages"),
    [
        (partial(laser_problem, scale=4.0 * SCALE), STAGES[:1]),
        (partial(sonar_problem, change=seen_too_narrow), SONAR_STAGES[:1]),
    ],
    ids=["a wrong prior", "cones taken for beams"],
)
def test_what_is_wrong_is_caught(make: Callable[[int], Problem], stages: Stages) -> None:
    found, worst = shares_of(40, stages, make)
    assert worst > LIMIT, found.words()


def test_the_score_of_a_bin_knows_right_from_wrong() -> None:
    """Predictions that are right by construction, and the same made overconfident, in worlds that hang together."""
    rng = np.random.default_rng(SEED)
    right, bold = [], []
    for _ in range(60):
        p = rng.beta(0.4, 0.4, N_PROBES)
        black = rng.random(N_PROBES) < p
        right.append(World(np.empty(0, np.int64), True, 0, p, black))
        bold.append(right[-1]._replace(predicted=p**2 / (p**2 + (1.0 - p) ** 2)))
    fair, wrong = (Calibration((), 0, worlds, 0.0).shares() for worlds in (right, bold))
    assert np.abs(fair.z).max() < 3.5
    assert np.abs(wrong.z).max() > 5.0
    assert fair.n.sum() == 60 * N_PROBES


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "way", "n"), [("laser", "plain", 60), ("laser", "tempered", 30), ("sonar", "tempered", 30)]
)
def test_ranks_are_uniform_in_some_worlds(kind: str, way: str, n: int) -> None:
    """Nine quantities at 99 %, those outside asked again: a false alarm once in 1,000 runs."""
    first = run_arm(standard_arm(kind, way), n, 20261121, 2).outside()
    if first:
        assert not first.keys() & run_arm(standard_arm(kind, way), n, 20261122, 2).outside().keys()


POINT_SEED = 20261122
POINT_SCALE = 0.25
POINT_ROOM = Window(0.0, 0.0, 5.0, 4.0)
N_POINTS, N_POINT_DRAWS = 30, 49
"""Draws among which the truth is placed: some 16,000 steps or more apart, about twice the autocorrelation time."""
POINT_STAGES: Stages = ((400_000, 1.1), (800_000, 1.1))
POINT_NAMES = ("edges", "length", "black area", "log likelihood")
POINT_CONFIDENCE = 0.998
"""Of the band of each of four: one leaves it by chance once in 125."""


class Case(NamedTuple):
    """How the points observe, and where they lie: on a lattice or scattered."""

    law: Normal | Flips
    on_lattice: bool


CASES = {"gaussian, scattered": Case(Normal(sigma=0.8), False), "binary, lattice": Case(Flips(0.2), True)}


def point_values(draws: Draws, data: PointData) -> NDArray[np.float64]:
    """Numbers of each map, (n_draws, len(POINT_NAMES))."""
    density = log_density(data.model, data.readings.value)
    told = np.where(black_at_draws(draws, data.readings.xy), density[:, 1], density[:, 0]).sum(axis=1)
    return np.column_stack([draws.n_edges, draws.total_length(), black_areas(draws), told])


def point_world(case: Case, sharper: float, number: int) -> World:
    """Sample the posterior of one world; `sharper` is how much surer of the values than they are the model is."""
    rng = np.random.default_rng([POINT_SEED, number])
    truth = exact_draws(POINT_SCALE, POINT_ROOM, 1, rng)[0]
    xy = lattice(6, 0.0, 4.0) if case.on_lattice else rng.uniform(POINT_ROOM[:2], POINT_ROOM[2:], (N_POINTS, 2))
    data = observe(truth, case.law, xy, rng)
    model = data.model.replace(
        sigma=None if data.model.sigma is None else data.model.sigma / sharper,
        flip_probability=data.model.flip_probability / sharper,
    )
    target = Target(
        POINT_ROOM, POINT_SCALE, points=dataclasses.replace(data, model=model), execution=Execution(resolution=0.25)
    )
    probes = rng.uniform(POINT_ROOM[:2], POINT_ROOM[2:], (N_PROBES, 2))
    world, draws = sampled((target, truth, POINT_SEED + number, probes), POINT_STAGES)
    kept = Draws.from_colorings([draws[int(k)] for k in np.linspace(0, len(draws) - 1, N_POINT_DRAWS).astype(int)])
    own = point_values(Draws.from_colorings([truth]), data)[0]
    return world._replace(ranks=rank_of(own, point_values(kept, data), rng))


def worst_of_points(name: str, n_worlds: int, sharper: float = 1.0) -> tuple[Calibration, float]:
    found = calibrate(partial(point_world, CASES[name], sharper), n_worlds, POINT_NAMES, N_POINT_DRAWS)
    print(found.words())
    return found, float(np.abs(found.shares().z).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_probabilities_are_the_shares_observed_and_ranks_are_uniform(name: str) -> None:
    found, worst = worst_of_points(name, 60)
    assert worst < LIMIT, found.words()
    assert not found.outside(POINT_CONFIDENCE), found.words()


@pytest.mark.slow
def test_values_believed_too_much_are_caught() -> None:
    found, worst = worst_of_points("gaussian, scattered", 30, sharper=2.0)
    assert worst > LIMIT or found.outside(POINT_CONFIDENCE), found.words()
