"""Worlds, poses and readings of the model: the truth ranks uniformly among draws of map and trajectory.

Simulation-based calibration as in :mod:`tests.statistical.sbc`, of what `prf sample` does with uncertain poses: chains
start at the white map and at the given poses, walks are scaled as they go.
"""

from __future__ import annotations

import dataclasses
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.model.coloring import Draws, black_areas, black_at_draws
from prf.model.window import Window
from prf.poses.plane import wrapped
from prf.sampler import Ensemble, poses
from prf.sampler.target import Target
from tests.driving import advance, find_starts
from tests.reference.beams import Sensor
from tests.reference.pose_worlds import BOTH, DRIVEN, PoseWorld, Rig, begin, draw_pose_world
from tests.statistical.ranks import rank_of
from tests.statistical.sbc import Calibration, World, calibrate

pytestmark = pytest.mark.slow

SEED = 20261123
SMALL = Rig(0.15, n=2, window=Window(1.0, 1.0, 5.0, 5.0), sensor=Sensor(1.3, noise=0.1, outlier=0.15, miss=0.05))
"""Seven edges in the mean of the prior."""
NEAR = BOTH.ring._replace(max=1.2)
N_DRAWS, N_CHAINS, STEPS = 40, 2, 240_000
MAP_STEPS = 2_000
"""Between turns of poses: more of these in so many steps than by default."""
MOST_RHAT = 1.2
PLACES = np.array([(2.0, 2.0), (2.5, 3.5), (3.2, 3.0), (4.0, 2.5)])
CONFIDENCE = 0.998
"""Of the band of each quantity: of some 15 in four arms, with seeds that are fixed, one lies outside once in 9."""


def quantities(draws: Draws, offset: NDArray[np.float64], log_likelihood: NDArray[np.float64]) -> dict[str, NDArray]:
    """What is ranked, by name: of maps, of poses less the given ones (n_draws, n, 3), and of both."""
    colours = black_at_draws(draws, PLACES)
    found = {"edges": draws.n_edges, "length": draws.total_length(), "black area": black_areas(draws)}
    found |= {f"colour {k}": colours[:, k] for k in range(len(PLACES))}
    free = [i for i in range(offset.shape[1]) if offset[:, i].any()]
    found |= {f"pose {i} {axis}": offset[:, i, k] for i in free for k, axis in enumerate("xyt")}
    found |= {f"way {axis}": offset[:, -1, k] - offset[:, 0, k] for k, axis in enumerate("xyt")}
    return found | {"log likelihood": log_likelihood}


def rank_world(rig: Rig, noise: float, number: int) -> tuple[tuple[str, ...], World]:
    """Names, and ranks of one world's truth; given errors are taken for `noise` times as large."""
    rng = np.random.default_rng([SEED, rig.n_cones, rig.odometry is None, number])
    world = draw_pose_world(rig, rng)
    true_chain, _ = begin(world)
    sampler = Ensemble(as_given(world, noise), rng.spawn(N_CHAINS))
    find_starts(sampler)
    while sampler.step < STEPS:
        advance(sampler)
    sample, trajectory, found = sampler.sample(), sampler.trajectory(), sampler.diagnose()
    assert trajectory is not None
    rows = np.linspace(0, len(sample.draws) - 1, N_DRAWS).astype(int)
    draws = Draws.from_colorings([sample.draws[int(i)] for i in rows])
    drawn = quantities(draws, trajectory.draws[rows].astype(float), sample.functionals["log_likelihood"][rows])
    offset = world.truth - world.model.prior.given
    offset[:, 2] = wrapped(offset[:, 2])
    likely = true_chain.graph.sums[[c.LOG_LIKELIHOOD]]
    truth = quantities(Draws.from_colorings([world.coloring]), offset[None], likely)
    ranks = rank_of(np.array(list(truth.values()))[:, 0], np.array(list(drawn.values())).T, rng)
    rhat = max(one.rhat for one in found.values() if one.state == "varies")
    return tuple(truth), World(ranks, rhat < MOST_RHAT)


def as_given(world: PoseWorld, noise: float) -> Target:
    """The posterior as a log has it whose poses err: readings and chains at the given poses."""
    target, prior = world.target, world.model.prior
    model = dataclasses.replace(world.model, start=prior.given, prior=prior._replace(noise=noise * prior.noise))
    readings = [None if part is None else part.readings for part in (target.laser, target.sonar)]
    parts = zip((target.laser, target.sonar), model.placed(*readings, prior.given), strict=True)
    laser, sonar = (None if part is None else dataclasses.replace(part, readings=there) for part, there in parts)
    return dataclasses.replace(target, laser=laser, sonar=sonar, poses=model).with_execution(resolution=0.5)


def rank_worlds(rig: Rig, n_worlds: int, noise: float = 1.0) -> Calibration:
    """Worlds of a rig, all of which have the same names."""
    names: tuple[str, ...] = ()

    def make(number: int) -> World:
        nonlocal names
        names, world = rank_world(rig, noise, number)
        return world

    with mock.patch.object(poses, "MAP_STEPS", MAP_STEPS):
        found = calibrate(make, n_worlds)._replace(names=names)
    print(found.words())
    return found


ARMS = {
    "laser": (SMALL, 200),
    "odometry": (SMALL._replace(noise=None, odometry=DRIVEN.odometry), 200),
    "slips": (SMALL._replace(noise=None, odometry=DRIVEN.odometry, slip=0.3), 200),
    "laser, sonar and odometry": (SMALL._replace(n_beams=6, n_cones=4, odometry=BOTH.odometry, ring=NEAR), 100),
}


@pytest.mark.parametrize("arm", ARMS)
def test_the_truth_ranks_as_any_draw(arm: str) -> None:
    found = rank_worlds(*ARMS[arm])
    assert found.outside(CONFIDENCE) == {}
    assert found.agreed > 0.6


def test_errors_taken_for_a_third_of_what_they_are_show() -> None:
    outside = rank_worlds(SMALL, 40, noise=1.0 / 3.0).outside(CONFIDENCE)
    assert sum(f"pose {i} {axis}" in outside for i in range(2) for axis in "xyt") >= 3
