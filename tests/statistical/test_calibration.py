"""Worlds from the prior, readings from a sensor model: the posterior's probabilities are the shares observed.

If a point is black with posterior probability p, then of all such points in all such worlds a share p is black,
whatever p is and however the points were sorted by it. Points of one world hang together, so worlds are the unit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.model.coloring import Coloring, Draws, black_at, black_at_draws
from prf.model.window import Window
from prf.sampler import Sampler
from prf.sampler.posterior import LaserData, Settings, SonarData
from prf.sampler.tempering import LadderPlan
from prf.shell.cli.seeds import spawn_generators
from tests.reference.beams import Sensor
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.reference.worlds import draw_world

SEED = 20050726
SCALE = 0.15
ROOM = Window(0.0, 0.0, 10.0, 10.0)
SENSOR = Sensor(8.0)
N_SENSORS, N_BEAMS, N_POINTS = 3, 40, 100
SONAR_SEED = 20260107
RING = Ring(5.0, surface=(3.0, 0.3, 6.0, 3.0))
"""Blunter than the defaults, so that many readings come from a wall."""
N_CONES, VIEW = 12, 0.5
BINS = np.linspace(0.0, 1.0, 6)
LIMIT = 3.5
"""Five bins beyond it by chance: once in 430 for normal sums."""
Stages = tuple[tuple[int, float], ...]
STAGES: Stages = ((800_000, 1.05), (1_600_000, 1.05), (3_200_000, 1.2), (6_400_000, 1.2), (12_800_000, 1.2))
"""Steps at which four chains are asked whether they agree, and the R-hat (worst of all that is watched) that will do.

When to stop depends on the chains alone, never on the truth, so it cannot favour right answers.
"""
SONAR_STAGES: Stages = ((300_000, 1.1), (600_000, 1.1), (1_200_000, 1.2), (2_400_000, 1.2), (4_800_000, 1.2))
"""Sonar leaves more open, so chains agree sooner."""


class Problem(NamedTuple):
    """A posterior, the map from which its readings were drawn, the seed of the chains, and random points (n, 2)."""

    settings: Settings
    truth: Coloring
    seed: int
    points: NDArray[np.float64]


class Answer(NamedTuple):
    """Predicted probability (N_POINTS,) and observed colour of random points of one world; how well chains agreed."""

    predicted: NDArray[np.float64]
    black: NDArray[np.bool_]
    rhat: float


class Calibration(NamedTuple):
    """By bin: points, mean prediction, share observed, z-score with worlds as the unit."""

    n: NDArray[np.int64]
    predicted: NDArray[np.float64]
    observed: NDArray[np.float64]
    z: NDArray[np.float64]


def laser_problem(number: int, scale: float = SCALE, repeat: int = 1, tiles: int = 0) -> Problem:
    """`scale` and `repeat` (times that each reading is counted) are right by default."""
    world = draw_world(SCALE, ROOM, SENSOR, N_SENSORS, N_BEAMS, np.random.default_rng([SEED, number]))
    rows = np.tile(np.arange(world.data.readings.n_beams), repeat)
    data = LaserData(world.data.readings.select(rows), world.data.model)
    points = np.random.default_rng([SEED, number, 1]).uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2))
    return Problem(Settings(ROOM, scale, data, resolution=0.5, tiles=tiles), world.coloring, SEED + number, points)


def sonar_problem(number: int, change: Callable[[SonarData], SonarData] = lambda data: data) -> Problem:
    """`change` makes the readings that the sampler is given wrong."""
    rng = np.random.default_rng([SONAR_SEED, number])
    world = draw_sonar_world(SCALE, ROOM, RING, N_SENSORS, N_CONES, VIEW, rng)
    settings = Settings(ROOM, SCALE, resolution=0.5, sonar=change(world.data))
    return Problem(settings, world.coloring, SONAR_SEED + number, rng.uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2)))


def worst_rhat(sampler: Sampler) -> float:
    return max((found.rhat for found in sampler.diagnose().values() if found.state != "constant"), default=1.0)


def sampled(settings: Settings, seed: int, stages: Stages, rungs: int = 1) -> tuple[Draws, float]:
    """Draws of four chains in one thread, and how well the chains agree."""
    with Sampler(settings, spawn_generators(seed, 4), 1, plan=LadderPlan(rungs)) as sampler:
        for steps, enough in stages:
            while sampler.step < steps:
                sampler.advance()
            rhat = worst_rhat(sampler)
            if rhat < enough:
                break
        return sampler.sample().draws, rhat


def answer(problem: Problem, stages: Stages, rungs: int = 1) -> Answer:
    """Sample the posterior of one world, and ask for the colours of its points."""
    draws, rhat = sampled(problem.settings, problem.seed, stages, rungs)
    return Answer(black_at_draws(draws, problem.points).mean(axis=0), black_at(problem.truth, problem.points), rhat)


def calibrate(answers: list[Answer]) -> Calibration:
    predicted = np.array([found.predicted for found in answers])
    black = np.array([found.black for found in answers])
    which = np.minimum((predicted * (len(BINS) - 1)).astype(int), len(BINS) - 2)
    rows = []
    for k in range(len(BINS) - 1):
        inside = which == k
        surplus = np.where(inside, black - predicted, 0.0).sum(axis=1)
        error = np.sqrt((surplus**2).sum())
        n = inside.sum()
        rows.append((n, predicted[inside].sum() / max(n, 1), black[inside].sum() / max(n, 1), surplus.sum() / error))
    columns = np.array(rows).T
    return Calibration(columns[0].astype(np.int64), *columns[1:])


def report(found: Calibration, answers: list[Answer]) -> str:
    rhat = np.array([one.rhat for one in answers])
    table = [
        f"  {BINS[k]:.1f}-{BINS[k + 1]:.1f}: {found.n[k]:5d} points, predicted {found.predicted[k]:.3f}, "
        f"observed {found.observed[k]:.3f}, z {found.z[k]:+.2f}"
        for k in range(len(BINS) - 1)
    ]
    agreed = f"R-hat < 1.05 in {(rhat < 1.05).sum()}, < 1.2 in {(rhat < 1.2).sum()}, worst {rhat.max():.2f}"
    return "\n".join([f"{len(answers)} worlds, {agreed}; |z| < {LIMIT}", *table])


def run_worlds(
    n_worlds: int, stages: Stages, make: Callable[[int], Problem] = laser_problem, rungs: int = 1
) -> tuple[Calibration, list[Answer], str]:
    """Two worlds at a time; what was found, the answers, and both in words."""
    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(lambda number: answer(make(number), stages, rungs), range(n_worlds)))
    found = calibrate(answers)
    summary = report(found, answers)
    print(summary)
    return found, answers, summary


def seen_too_narrow(data: SonarData) -> SonarData:
    """Cones of 29 degrees taken for beams of 3: walls to the side of the axis are put on it."""
    readings = dataclasses.replace(data.readings, cone=np.full(data.readings.n_beams, 0.05))
    return dataclasses.replace(data, readings=readings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "stages"), [(laser_problem, STAGES), (sonar_problem, SONAR_STAGES)], ids=["laser", "sonar"]
)
def test_probabilities_are_the_shares_observed(make: Callable[[int], Problem], stages: Stages) -> None:
    found, answers, summary = run_worlds(40, stages, make)
    assert np.abs(found.z).max() < LIMIT, summary
    assert (found.n >= 100).all(), summary
    # Chains that do not mix would miss the shares, or hit them by luck: neither says anything about the sampler.
    assert np.mean([one.rhat < 1.2 for one in answers]) > 0.9, summary


@pytest.mark.slow
def test_probabilities_are_the_shares_observed_with_a_ladder() -> None:
    """Fewer worlds, each of which costs three times as much."""
    found, answers, summary = run_worlds(12, STAGES[:2], rungs=3)
    assert np.abs(found.z).max() < LIMIT, summary
    assert np.mean([one.rhat < 1.2 for one in answers]) > 0.8, summary


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
    found, _, summary = run_worlds(40, stages, make)
    assert np.abs(found.z).max() > LIMIT, summary


def test_the_score_of_a_bin_knows_right_from_wrong() -> None:
    """Predictions that are right by construction, and the same made overconfident, in worlds that hang together."""
    rng = np.random.default_rng(SEED)
    right, bold = [], []
    for _ in range(60):
        p = rng.beta(0.4, 0.4, N_POINTS)
        black = rng.random(N_POINTS) < p
        right.append(Answer(p, black, 1.0))
        bold.append(Answer(p**2 / (p**2 + (1.0 - p) ** 2), black, 1.0))
    assert np.abs(calibrate(right).z).max() < 3.5
    assert np.abs(calibrate(bold).z).max() > 5.0
    assert calibrate(right).n.sum() == 60 * N_POINTS
