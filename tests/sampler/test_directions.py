"""Directions that are sampled with the map: what is kept up to date, recorded, resumed, and refused."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.model.arak import exact_draws
from prf.model.orientation import Orientation
from prf.model.window import Window
from prf.sampler import Ensemble
from prf.sampler.checkpoint import load_checkpoint, save_checkpoint
from prf.sampler.directions import redraw_directions
from prf.sampler.prepare import ladder_plan
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Execution, Target, make_chain
from prf.shell.errors import ConfigError
from tests.driving import advance
from tests.factories import make_run
from tests.reference.recompute import differences
from tests.reference.worlds import draw_world
from tests.statistical.problems import N_BEAMS, N_SENSORS, ROOM, SENSOR

WINDOW = Window(0.0, 0.0, 4.0, 3.0)


@pytest.mark.parametrize("known", [Orientation(None, None), Orientation(2.0, None), Orientation(None, 0.3)])
def test_a_redraw_keeps_the_sum_and_what_is_given(known: Orientation) -> None:
    target = Target(WINDOW, 1.0, orientation=known)
    chain = make_chain(target, exact_draws(1.0, WINDOW, 1, np.random.default_rng(1))[0])
    seen = set()
    for seed in range(20):
        redraw_directions(chain, known, np.random.default_rng(seed))
        assert differences(chain) == []
        seen.add((float(chain.lines[c.ORIENTATION]), float(chain.lines[c.ANGLE])))
    strengths, angles = (len(set(values)) for values in zip(*seen, strict=True))
    assert (strengths > 1, angles > 1) == (known.strength is None, known.angle is None)
    assert all(0.0 <= angle < 0.5 * math.pi for _, angle in seen)


def laser_target(free_space: float = 0.0) -> Target:
    world = draw_world(0.15, ROOM, SENSOR, N_SENSORS, N_BEAMS, np.random.default_rng(5))
    return Target(
        ROOM,
        0.15,
        world.data,
        orientation=Orientation(None, None),
        free_space=free_space,
        execution=Execution(resolution=0.25),
    )


def run_to(sampler: Ensemble, steps: int) -> Ensemble:
    while sampler.step < steps:
        advance(sampler)
    return sampler


def test_ground_that_no_reading_concerns_is_drawn_under_the_same_prior() -> None:
    """A chain whose map is turned over there is what its map says, black area and directions among it."""
    sampler = Ensemble(laser_target(0.2), np.random.default_rng(8).spawn(1))
    (run,) = run_to(sampler, 60_000).chains
    assert differences(run.chain) == []
    assert run.ground is not None
    run.redraw_ground(200_000)
    run.settle()
    assert differences(run.chain) == []
    assert run.chain.graph.counts[c.EDGES] > 0


@pytest.mark.parametrize("temperatures", [1, 3])
def test_a_resumed_run_goes_on_with_its_directions(temperatures: int, tmp_path: Path) -> None:
    def fresh() -> Ensemble:
        plan = LadderPlan(temperatures, lowest=0.0 if temperatures > 1 else None)
        return Ensemble(laser_target(), np.random.default_rng(7).spawn(2), plan=plan)

    whole = run_to(fresh(), 60_000)
    half = run_to(fresh(), 30_000)
    save_checkpoint(tmp_path, half, "one")
    resumed = fresh()
    load_checkpoint(tmp_path, resumed, "one")
    found, expected = run_to(resumed, 60_000).sample(), whole.sample()
    for name in ("orientation", "orientation_angle", "log_posterior"):
        assert np.array_equal(found.functionals[name], expected.functionals[name])
    assert np.ptp(found.functionals["orientation"]) > 0.0


def test_a_run_says_where_its_walls_lead() -> None:
    run = make_run(n_draws=30)
    assert run.building is None
    draws = exact_draws(0.3, WINDOW, 30, np.random.default_rng(2), Orientation(10.0, 0.2))
    directions = {"orientation": np.full(30, 10.0), "orientation_angle": np.full(30, 0.2)}
    found = dataclasses.replace(run, draws=draws, functionals=directions).building
    assert found is not None
    assert found["angle"] == pytest.approx(0.2, abs=0.06)
    assert (found["orientation"], found["orientation_sd"]) == (10.0, 0.0)


def test_the_hottest_chain_has_no_exact_draws_where_black_costs_something() -> None:
    config = Configuration.of(temperatures=3, lowest_inverse_temperature=0.0, free_space=0.1)
    with pytest.raises(ConfigError, match="free_space"):
        ladder_plan(config)
