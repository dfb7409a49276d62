"""Worlds from the prior, readings from the sensor model: the posterior's probabilities are the shares observed.

If a point is black with posterior probability p, then of all such points in all such worlds a share p is black,
whatever p is and however the points were sorted by it. Points of one world hang together, so worlds are the unit.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.coloring import black_at, black_at_draws
from prf.posterior import LaserData, Settings
from prf.sampler import Sampler
from prf.sampler.tempering import LadderPlan
from prf.shell.seeds import spawn_generators
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.worlds import World, draw_world

SEED = 20050726
SCALE = 0.15
ROOM = Window(0.0, 0.0, 10.0, 10.0)
SENSOR = Sensor(8.0)
N_SENSORS, N_BEAMS, N_POINTS = 3, 40, 100
BINS = np.linspace(0.0, 1.0, 6)
LIMIT = 3.5
"""Five bins beyond it by chance: once in 430 for normal sums."""
Stages = tuple[tuple[int, float], ...]
STAGES: Stages = ((800_000, 1.05), (1_600_000, 1.05), (3_200_000, 1.2), (6_400_000, 1.2), (12_800_000, 1.2))
"""Steps at which four chains are asked whether they agree, and the R-hat (worst of all that is watched) that will do.

When to stop depends on the chains alone, never on the truth, so it cannot favour right answers.
"""


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


def make_world(number: int) -> World:
    rng = np.random.default_rng([SEED, number])
    return draw_world(SCALE, ROOM, SENSOR, N_SENSORS, N_BEAMS, rng)


def worst_rhat(sampler: Sampler) -> float:
    return max((found.rhat for found in sampler.diagnose().values() if found.state != "constant"), default=1.0)


def answer(
    number: int, data: LaserData, world: World, scale: float, stages: Stages, tiles: int = 0, temperatures: int = 1
) -> Answer:
    """Sample the posterior of one world, in one thread, and ask for the colours of random points."""
    settings = Settings(ROOM, scale, data, resolution=0.5, tiles=tiles)
    with Sampler(settings, spawn_generators(SEED + number, 4), 1, plan=LadderPlan(temperatures)) as sampler:
        for steps, enough in stages:
            while sampler.step < steps:
                sampler.advance()
            rhat = worst_rhat(sampler)
            if rhat < enough:
                break
        draws = sampler.sample().draws
    points = np.random.default_rng([SEED, number, 1]).uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2))
    return Answer(black_at_draws(draws, points).mean(axis=0), black_at(world.coloring, points), rhat)


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
    return "\n".join([f"seed {SEED}, {len(answers)} worlds, {agreed}; |z| < {LIMIT}", *table])


def run_worlds(
    n_worlds: int, stages: Stages, scale: float = SCALE, repeat: int = 1, tiles: int = 0, temperatures: int = 1
) -> tuple[Calibration, list[Answer]]:
    """Two worlds at a time. `scale` and `repeat` (times that each reading is counted) are right by default."""

    def one(number: int) -> Answer:
        world = make_world(number)
        rows = np.tile(np.arange(world.data.readings.n_beams), repeat)
        data = LaserData(world.data.readings.select(rows), world.data.model)
        return answer(number, data, world, scale, stages, tiles, temperatures)

    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(one, range(n_worlds)))
    return calibrate(answers), answers


@pytest.mark.slow
def test_probabilities_are_the_shares_observed() -> None:
    found, answers = run_worlds(40, STAGES)
    summary = report(found, answers)
    print(summary)
    assert np.abs(found.z).max() < LIMIT, summary
    assert (found.n >= 100).all(), summary
    # Chains that do not mix would miss the shares, or hit them by luck: neither says anything about the sampler.
    assert np.mean([one.rhat < 1.2 for one in answers]) > 0.9, summary


@pytest.mark.slow
def test_probabilities_are_the_shares_observed_with_a_ladder() -> None:
    """Fewer worlds, each of which costs three times as much."""
    found, answers = run_worlds(12, STAGES[:2], temperatures=3)
    summary = report(found, answers)
    print(summary)
    assert np.abs(found.z).max() < LIMIT, summary
    assert np.mean([one.rhat < 1.2 for one in answers]) > 0.8, summary


@pytest.mark.slow
def test_a_wrong_prior_is_caught() -> None:
    found, answers = run_worlds(40, STAGES[:1], scale=4.0 * SCALE)
    summary = report(found, answers)
    print(summary)
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
