"""What readings gain by new poses, held to a chain made there; and decided early as with all of it."""

from __future__ import annotations

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses.change import readings_change, sites_are_white
from prf.kernels.poses.state import LOG_CHANGE
from prf.model.coloring import black_at
from prf.sampler.posterior import make_chain
from tests.kernels.test_poses import FAR, placed
from tests.reference.pose_worlds import LASER, Rig, begin, draw_pose_world

pytestmark = pytest.mark.uncompiled


def test_readings_gain_what_a_chain_made_at_the_new_poses_has_more() -> None:
    """But for those that a chain made there would take for readings of another kind."""
    rng = np.random.default_rng(5)
    world = draw_pose_world(FAR, rng)
    chain, turns = begin(world)
    state, held = turns.state, 0
    for _ in range(12):
        state.new_pose[:] = world.truth + rng.normal(0.0, 0.03, (FAR.n, 3))
        there = placed(world.settings, state.new_pose)
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
