"""Worlds from the prior, readings from the sonar model: the posterior's probabilities are the shares observed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from prf.coloring import black_at, black_at_draws
from prf.posterior import Settings, SonarData
from prf.sampler import Sampler
from prf.shell.seeds import spawn_generators
from prf.window import Window
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.statistical.test_calibration import LIMIT, Answer, Calibration, Stages, calibrate, report, worst_rhat

SEED = 20260107
SCALE = 0.15
ROOM = Window(0.0, 0.0, 10.0, 10.0)
RING = Ring(5.0, surface=(3.0, 0.3, 6.0, 3.0))
"""Blunter than the defaults, so that many readings come from a wall."""
N_SENSORS, N_CONES, VIEW, N_POINTS = 3, 12, 0.5, 100
STAGES: Stages = ((300_000, 1.1), (600_000, 1.1), (1_200_000, 1.2), (2_400_000, 1.2), (4_800_000, 1.2))
"""As for the laser; sonar leaves more open, so chains agree sooner."""


def answer(number: int, change: Callable[[SonarData], SonarData], stages: Stages) -> Answer:
    """Sample the posterior of one world, in one thread, and ask for the colours of random points."""
    rng = np.random.default_rng([SEED, number])
    world = draw_sonar_world(SCALE, ROOM, RING, N_SENSORS, N_CONES, VIEW, rng)
    settings = Settings(ROOM, SCALE, resolution=0.5, sonar=change(world.data))
    with Sampler(settings, spawn_generators(SEED + number, 4), 1) as sampler:
        for steps, enough in stages:
            while sampler.step < steps:
                sampler.advance()
            rhat = worst_rhat(sampler)
            if rhat < enough:
                break
        draws = sampler.sample().draws
    points = rng.uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2))
    return Answer(black_at_draws(draws, points).mean(axis=0), black_at(world.coloring, points), rhat)


def run_worlds(
    n_worlds: int, stages: Stages, change: Callable[[SonarData], SonarData] = lambda data: data
) -> tuple[Calibration, list[Answer]]:
    """Two worlds at a time; `change` makes the readings that the sampler is given wrong."""
    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(lambda number: answer(number, change, stages), range(n_worlds)))
    return calibrate(answers), answers


@pytest.mark.slow
def test_probabilities_are_the_shares_observed() -> None:
    found, answers = run_worlds(40, STAGES)
    summary = report(found, answers)
    print(summary)
    assert np.abs(found.z).max() < LIMIT, summary
    assert (found.n >= 100).all(), summary
    assert np.mean([one.rhat < 1.2 for one in answers]) > 0.9, summary


def seen_too_narrow(data: SonarData) -> SonarData:
    """Cones of 29 degrees taken for beams of 3: walls to the side of the axis are put on it."""
    readings = dataclasses.replace(data.readings, cone=np.full(data.readings.n_beams, 0.05))
    return dataclasses.replace(data, readings=readings)


@pytest.mark.slow
def test_cones_taken_for_beams_are_caught() -> None:
    found, answers = run_worlds(40, STAGES[:1], seen_too_narrow)
    summary = report(found, answers)
    print(summary)
    assert np.abs(found.z).max() > LIMIT, summary
