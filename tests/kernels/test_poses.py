"""Poses and what follows from them, held to the slow twins: the prior, readings placed, colours."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses.state import is_white, log_pose_prior, place_readings
from prf.kernels.readings import cones
from prf.model.arak import exact_draws
from prf.model.coloring import black_at
from prf.model.window import Window
from prf.sampler.posterior import Settings, make_chain, poses_of, rays_of
from tests.reference.beams import Sensor
from tests.reference.pose_worlds import BOTH, DRIVEN, LASER, Rig, begin, draw_pose_world
from tests.reference.slow_sonar import Ring

pytestmark = pytest.mark.uncompiled

NEAR_BORDER = Window(2.0, 2.0, 4.0, 4.0)
FAR = Rig(n=2, n_beams=40, n_cones=6, sensor=Sensor(5.0), ring=Ring(4.0), window=NEAR_BORDER, odometry=(0.2,) * 4)
"""Most beams and cones leave the window."""


@pytest.mark.parametrize("rig", [LASER, DRIVEN, BOTH], ids=["errors", "odometry", "both"])
def test_the_prior_of_poses_is_that_of_the_model(rig: Rig) -> None:
    rng = np.random.default_rng(1)
    world = draw_pose_world(rig, rng)
    _, turns = begin(world)
    state, n = turns.state, rig.n
    for _ in range(20):
        before, after = (world.truth + rng.normal(0.0, [0.1, 0.1, 1.5], (n, 3)) for _ in range(2))
        after[:, 2] += 2.0 * np.pi * rng.integers(-1, 2, n)
        whole = world.model.prior.log_density(after)
        assert log_pose_prior(state, after, 0, n - 1) == pytest.approx(whole, rel=1e-12)
        low = int(rng.integers(n))
        high = int(rng.integers(low, n))
        mixed = before.copy()
        mixed[low : high + 1] = after[low : high + 1]
        part = log_pose_prior(state, mixed, low, high) - log_pose_prior(state, before, low, high)
        changed = world.model.prior.log_density(mixed) - world.model.prior.log_density(before)
        assert part == pytest.approx(changed, rel=1e-9, abs=1e-9)


def test_readings_are_placed_as_if_they_were_read_there() -> None:
    rng = np.random.default_rng(2)
    world = draw_pose_world(FAR, rng)
    chain, turns = begin(world)
    kinds = rays_of(world.settings)[:, c.RANGE] >= 0.0, poses_of(world.settings)[:, cones.READING] < np.inf
    changed = 0
    for _ in range(10):
        turns.state.pose[:] = world.truth + rng.normal(0.0, 0.1, (FAR.n, 3))
        ray, cone = chain.beams.ray.copy(), chain.cones.pose.copy()
        place_readings(turns.state, chain.graph.window, chain.beams.model, FAR.ring.max, ray, cone)
        settings = placed(world.settings, turns.state.pose)
        rays, poses = rays_of(settings), poses_of(settings)
        same = (rays[:, c.RANGE] >= 0.0) == kinds[0]
        np.testing.assert_allclose(ray[same, : c.RANGE + 1], rays[same, : c.RANGE + 1], rtol=1e-12, atol=1e-12)
        assert (ray[kinds[0], c.RANGE] == world.settings.laser.readings.range[kinds[0]]).all()
        same = (poses[:, cones.READING] < np.inf) == kinds[1]
        np.testing.assert_allclose(cone[same, : cones.MAX_DISTANCE], poses[same, : cones.MAX_DISTANCE], rtol=1e-9)
        reach = np.where(kinds[1] & same, np.maximum(poses[:, 6], poses[:, 5] * (1 + 1e-6)), poses[:, 6])[same]
        np.testing.assert_allclose(cone[same, cones.MAX_DISTANCE], reach, rtol=1e-9)
        changed += np.count_nonzero(~same)
    assert (rays[:, c.RANGE] < 0.0).any()
    assert changed < 20


def placed(settings: Settings, pose: np.ndarray) -> Settings:
    """The settings with all readings where these poses have them."""
    assert settings.poses is not None
    assert settings.laser is not None
    assert settings.sonar is not None
    laser, sonar = settings.poses.placed(settings.laser.readings, settings.sonar.readings, pose)
    assert laser is not None
    assert sonar is not None
    return dataclasses.replace(
        settings,
        laser=dataclasses.replace(settings.laser, readings=laser),
        sonar=dataclasses.replace(settings.sonar, readings=sonar),
    )


def test_a_place_is_white_where_the_map_is() -> None:
    rng, room = np.random.default_rng(3), Window(-3.0, 1.0, 2.0, 4.0)
    for coloring in exact_draws(0.5, room, 12, rng):
        chain = make_chain(Settings(room, 0.5, cell=0.4), coloring)
        places = np.vstack([rng.uniform(room[:2], room[2:], (40, 2)), [(-0.5, 2.5)]])
        anchor = chain.graph.counts[c.ANCHOR_BLACK]
        found = [is_white(chain.graph, chain.edge_index, anchor, x, y, np.zeros(8)) for x, y in places.tolist()]
        np.testing.assert_array_equal(found, ~black_at(coloring, places))
