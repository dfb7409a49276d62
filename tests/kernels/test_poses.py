"""Poses and what follows from them, held to the slow twins: the prior, readings placed, colours."""

from __future__ import annotations

import dataclasses
import math
from unittest import mock

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses import moves as p
from prf.kernels.poses.change import readings_change, sites_are_white
from prf.kernels.poses.state import LOG_CHANGE, WARP, Poses, log_pose_prior, place_readings
from prf.kernels.poses.turn import run_poses
from prf.kernels.readings import cones
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.free_space import is_white
from prf.model.arak import exact_draws
from prf.model.coloring import black_at
from prf.model.window import Window
from prf.sampler.target import Execution, Target, make_chain, poses_of, rays_of, run_chain
from tests.kernels.entries import parts_are_called
from tests.reference.beams import Sensor
from tests.reference.chain_state import structural_faults
from tests.reference.pose_worlds import BARE, BOTH, DRIVEN, LASER, UNLIKE, Rig, begin, draw_pose_world, scratch
from tests.reference.recompute import differences
from tests.reference.slow_sonar import Ring

pytestmark = pytest.mark.uncompiled

NEAR_BORDER = Window(2.0, 2.0, 4.0, 4.0)
FAR = Rig(n=2, n_beams=40, n_cones=6, sensor=Sensor(5.0), ring=Ring(4.0), window=NEAR_BORDER, odometry=(0.2,) * 4)
"""Most beams and cones leave the window."""


@parts_are_called
@pytest.mark.parametrize("rig", [LASER, UNLIKE, DRIVEN, BOTH], ids=["errors", "unlike errors", "odometry", "both"])
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
    kinds = rays_of(world.target)[:, c.RANGE] >= 0.0, poses_of(world.target)[:, cones.READING] < np.inf
    changed = 0
    for _ in range(10):
        turns.state.pose[:] = world.truth + rng.normal(0.0, 0.1, (FAR.n, 3))
        ray, cone = chain.beams.ray.copy(), chain.cones.pose.copy()
        place_readings(turns.state, chain.graph.window, chain.beams.model, FAR.ring.max, ray, cone)
        target = placed(world.target, turns.state.pose)
        rays, poses = rays_of(target), poses_of(target)
        same = (rays[:, c.RANGE] >= 0.0) == kinds[0]
        np.testing.assert_allclose(ray[same, : c.RANGE + 1], rays[same, : c.RANGE + 1], rtol=1e-12, atol=1e-12)
        assert (ray[kinds[0], c.RANGE] == world.target.laser.readings.range[kinds[0]]).all()
        same = (poses[:, cones.READING] < np.inf) == kinds[1]
        np.testing.assert_allclose(cone[same, : cones.MAX_DISTANCE], poses[same, : cones.MAX_DISTANCE], rtol=1e-9)
        reach = np.where(kinds[1] & same, np.maximum(poses[:, 6], poses[:, 5] * (1 + 1e-6)), poses[:, 6])[same]
        np.testing.assert_allclose(cone[same, cones.MAX_DISTANCE], reach, rtol=1e-9)
        changed += np.count_nonzero(~same)
    assert (rays[:, c.RANGE] < 0.0).any()
    assert changed < 20


def placed(target: Target, pose: np.ndarray) -> Target:
    """The settings with all readings where these poses have them."""
    assert target.poses is not None
    assert target.laser is not None
    assert target.sonar is not None
    laser, sonar = target.poses.placed(target.laser.readings, target.sonar.readings, pose)
    assert laser is not None
    assert sonar is not None
    return dataclasses.replace(
        target,
        laser=dataclasses.replace(target.laser, readings=laser),
        sonar=dataclasses.replace(target.sonar, readings=sonar),
    )


@parts_are_called
def test_a_place_is_white_where_the_map_is() -> None:
    rng, room = np.random.default_rng(3), Window(-3.0, 1.0, 2.0, 4.0)
    for coloring in exact_draws(0.5, room, 12, rng):
        chain = make_chain(Target(room, 0.5, execution=Execution(cell=0.4)), coloring)
        places = np.vstack([rng.uniform(room[:2], room[2:], (40, 2)), [(-0.5, 2.5)]])
        anchor = chain.graph.counts[c.ANCHOR_BLACK]
        found = [is_white(chain.graph, chain.edge_index, anchor, x, y, c.NONE) for x, y in places.tolist()]
        np.testing.assert_array_equal(found, ~black_at(coloring, places))


# What readings gain by new poses, held to a chain made there; and decided early as with all of it.


@parts_are_called
def test_readings_gain_what_a_chain_made_at_the_new_poses_has_more() -> None:
    """But for those that a chain made there would take for readings of another kind."""
    rng = np.random.default_rng(5)
    world = draw_pose_world(FAR, rng)
    chain, turns = begin(world)
    state, held = turns.state, 0
    for _ in range(12):
        state.new_pose[:] = world.truth + rng.normal(0.0, 0.03, (FAR.n, 3))
        there = placed(world.target, state.new_pose)
        fresh = make_chain(there, world.coloring)
        places = np.concatenate([there.laser.readings.origin, there.sonar.readings.origin])
        assert all(
            sites_are_white(chain.graph, chain.edge_index, state, i, chain.graph.counts[c.ANCHOR_BLACK])
            == (not black_at(world.coloring, rows).any())
            for i, rows in enumerate(by_pose(places))
        )
        assert readings_change(chain.graph, chain.edge_index, chain.beams, chain.cones, state, 0, FAR.n - 1, -np.inf)
        same = np.sign(fresh.beams.ray[:, c.RANGE]) == np.sign(chain.beams.ray[:, c.RANGE])
        if same.all() and (np.isfinite(fresh.cones.pose[:, 5]) == np.isfinite(chain.cones.pose[:, 5])).all():
            gained = fresh.graph.sums[c.LOG_LIKELIHOOD] - chain.graph.sums[c.LOG_LIKELIHOOD]
            assert state.sums[LOG_CHANGE] == pytest.approx(gained, abs=1e-9)
            np.testing.assert_allclose(state.new_ray, fresh.beams.ray, rtol=1e-9, atol=1e-12)
            np.testing.assert_array_equal(state.new_edge, fresh.beams.impact_edge)
            np.testing.assert_allclose(state.new_cone, fresh.cones.pose, rtol=1e-5, atol=1e-12)
            held += 1
    assert held >= 4


def by_pose(places: np.ndarray) -> list[np.ndarray]:
    """The places of all sensors of each pose: beams are listed by pose, and so are cones."""
    beams, rings = np.split(places, [FAR.n * FAR.n_beams])
    return [np.concatenate(rows) for rows in zip(np.split(beams, FAR.n), np.split(rings, FAR.n), strict=True)]


@parts_are_called
@pytest.mark.parametrize("rig", [LASER, FAR._replace(n_cones=0)], ids=["within", "beyond the window"])
def test_an_early_decision_is_that_of_all_readings(rig: Rig) -> None:
    rng = np.random.default_rng(6)
    world = draw_pose_world(rig, rng)
    chain, turns = begin(world)
    state, decided = turns.state, [0, 0, 0]
    fixed = chain.graph, chain.edge_index, chain.beams, chain.cones, state
    for _ in range(60):
        state.new_pose[:] = world.truth + rng.normal(0.0, 0.05, (rig.n, 3))
        low = int(rng.integers(rig.n))
        high = int(rng.integers(low, rig.n))
        assert readings_change(*fixed, low, high, -np.inf)
        gained = float(state.sums[LOG_CHANGE])
        needed = gained + float(rng.standard_exponential() * rng.choice([-1.0, 1.0, 10.0]))
        state.sums[LOG_CHANGE] = np.nan
        accepted = readings_change(*fixed, low, high, needed)
        assert accepted == (needed < gained)
        decided[0 if accepted else 1 if np.isnan(state.sums[LOG_CHANGE]) else 2] += 1
    assert decided[0] > 5
    assert decided[1] > 5, "none was decided early"


# Moves of poses on a map that stays: each is undone by its opposite and keeps volume.


MANY = BARE._replace(n=4)
BOTH_WAYS = pytest.mark.parametrize("kind", ["shift", "bend by a turn", "bend by a shift"])


def propose(state: Poses, kind: str, motion: np.ndarray, ends: tuple[int, int]) -> np.ndarray:
    """The poses that a stretch moved by a given motion would come to."""

    def drawn(poses: Poses, i: int, scale: float, rng: object, out: np.ndarray) -> None:
        out[:3] = motion

    class Coin:
        def random(self) -> float:
            return 0.0 if kind == "bend by a turn" else 0.9

    found = []
    with (
        mock.patch.object(p, "spread_of", drawn),
        mock.patch.object(p, "draw_stretch", return_value=ends),
        mock.patch.object(p, "random_scale", return_value=1.0),
        mock.patch.object(p, "decide", lambda chain, poses, low, high, ratio, rng: found.append((low, high, ratio))),
    ):
        p.move_stretch(None, state, kind != "shift", Coin())
    assert found == [(*ends, 0.0)]
    return state.new_pose[ends[0] : ends[1] + 1].copy()


@parts_are_called
@BOTH_WAYS
@pytest.mark.parametrize("ends", [(0, 3), (1, 3), (1, 2)])
def test_a_stretch_is_led_back_by_the_opposite_and_keeps_volume(kind: str, ends: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    _, turns = begin(draw_pose_world(MANY, rng))
    state, motion = turns.state, np.array([0.3, -0.2, 0.7])
    before, stretch = state.pose.copy(), slice(ends[0], ends[1] + 1)
    there = propose(state, kind, motion, ends)
    state.pose[stretch] = there
    np.testing.assert_allclose(propose(state, kind, -motion, ends), before[stretch], atol=1e-14)
    columns = []
    for k in range(3 * len(there)):
        step = np.zeros(3 * len(there))
        step[k] = 1e-6
        both = []
        for sign in (1.0, -1.0):
            state.pose[:] = before
            state.pose[stretch] += sign * step.reshape(-1, 3)
            both.append(propose(state, kind, motion, ends).ravel())
        columns.append((both[0] - both[1]) / 2e-6)
    assert np.linalg.det(np.array(columns)) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(there - before[stretch]).max() > 0.1


@parts_are_called
def test_stretches_are_drawn_alike_wherever_they_are() -> None:
    """Their place is uniform given their length; the first pose stays where nothing else fixes the frame."""
    rng = np.random.default_rng(2)
    for rig, first in ((MANY, 0), (DRIVEN._replace(n=4), 1)):
        _, turns = begin(draw_pose_world(rig, rng))
        assert p.first_free(turns.state) == first
        drawn = np.array([p.draw_stretch(turns.state, rng) for _ in range(4000)])
        assert drawn.min() == first
        assert drawn.max() == 3
        for length in range(2, 5 - first):
            low = drawn[np.diff(drawn, axis=1)[:, 0] == length - 1, 0]
            places = np.bincount(low - first, minlength=5 - first - length)
            mean = len(low) / len(places)
            # 4.5 standard deviations: by chance once in 147,000, four numbers at most.
            assert np.abs(places - mean).max() < 4.5 * math.sqrt(mean) + 1e-9


# Turns of poses: what is added up on the way is what a look at map and poses says, for all sensors and priors.


SONAR = BOTH._replace(n_beams=0, odometry=None)
RIGS = {"laser": LASER, "sonar": SONAR, "both": BOTH, "odometry": DRIVEN, "beyond the window": FAR}
RIGS["unlike errors"] = UNLIKE


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS.keys())
def test_what_is_added_up_is_that_of_map_and_poses(rig: Rig) -> None:
    """Before anything is laid out anew: impacts to the last bit, sums up to rounding; then the lists."""
    rng = np.random.default_rng(12)
    world = draw_pose_world(rig, rng)
    chain, turns = begin(world)
    turns.state.spread[:] = [0.03, 0.0, 0.03, 0.0, 0.0, 0.03]
    for until in (60, 120):
        chain = run_chain(chain, rng, until - 40)
        run_poses(chain, *scratch(chain), turns.state, 0.3, until, rng)
        kept = [array.copy() for array in (chain.beams.ray, chain.cones.pose, chain.beams.impact_edge)]
        sums, prior = chain.graph.sums.copy(), turns.log_prior
        assert prior == pytest.approx(world.model.prior.log_density(turns.state.pose), abs=1e-9)
        chain = turns.laid_out(chain)
        trace_all(chain)
        recompute_sums(chain)
        np.testing.assert_allclose(sums[1:], chain.graph.sums[1:], rtol=1e-9, atol=1e-9)
        for now, then in zip((chain.beams.ray, chain.cones.pose, chain.beams.impact_edge), kept, strict=True):
            np.testing.assert_array_equal(now, then)
        assert differences(chain) == []
        assert structural_faults(chain) == []
    assert turns.state.outcomes[:, c.ACCEPTED].sum() > 10
    assert turns.state.outcomes[WARP, c.ACCEPTED] > 0


def test_the_image_follows_a_turn() -> None:
    rng = np.random.default_rng(11)
    world = draw_pose_world(LASER, rng)
    chain, turns = begin(world._replace(target=world.target.with_execution(resolution=0.5)))
    turns.warps = 0.5
    assert differences(turns.move(chain, rng, 30)) == []
    assert turns.state.outcomes[WARP, c.ACCEPTED] > 0
