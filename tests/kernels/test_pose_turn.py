"""Turns of poses: what is added up on the way is what a look at map and poses says, for all sensors and priors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.build import recompute_sums, trace_all
from prf.kernels.pose_turn import run_poses
from prf.kernels.poses import LOG_POSE_PRIOR, WARP
from prf.layout import run_chain
from tests.kernels.test_poses import FAR
from tests.reference.chain_state import structural_faults
from tests.reference.pose_worlds import BOTH, DRIVEN, LASER, Rig, begin, draw_pose_world, scratch
from tests.reference.recompute import differences

pytestmark = pytest.mark.uncompiled

SONAR = BOTH._replace(n_beams=0, odometry=None)
RIGS = {"laser": LASER, "sonar": SONAR, "both": BOTH, "odometry": DRIVEN, "beyond the window": FAR}


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS.keys())
def test_sums_and_lists_are_those_of_map_and_poses(rig: Rig) -> None:
    rng = np.random.default_rng(11)
    world = draw_pose_world(rig, rng)
    settings = dataclasses.replace(world.settings, resolution=0.5)
    chain, turns = begin(world._replace(settings=settings))
    turns.state.spread[:] = [0.03, 0.0, 0.03, 0.0, 0.0, 0.03]
    turns.warps = 0.3
    for until in (60, 120):
        chain = run_chain(chain, rng, until - 40)
        chain = turns.move(chain, rng, until)
        assert differences(chain) == []
        assert structural_faults(chain) == []
        prior = world.model.prior
        assert turns.log_prior == pytest.approx(prior.log_density(turns.state.pose), abs=1e-9)
    done = turns.state.outcomes[:, c.ACCEPTED]
    assert done.sum() > 10
    assert done[WARP] > 0


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS.keys())
def test_a_turn_keeps_its_sums_and_impacts_step_by_step(rig: Rig) -> None:
    """Before anything is laid out anew: impacts to the last bit, sums up to rounding."""
    rng = np.random.default_rng(12)
    chain, turns = begin(draw_pose_world(rig, rng))
    turns.state.spread[:] = [0.03, 0.0, 0.03, 0.0, 0.0, 0.03]
    run_poses(chain, *scratch(chain), turns.state, 0.3, 40, rng)
    kept = chain.graph.sums.copy(), turns.log_prior, chain.beams.ray.copy(), chain.cones.pose.copy()
    edges = chain.beams.impact_edge.copy()
    chain = turns.laid_out(chain)
    trace_all(chain)
    recompute_sums(chain)
    np.testing.assert_allclose(kept[0][1:], chain.graph.sums[1:], rtol=1e-9, atol=1e-9)
    assert kept[1] == pytest.approx(turns.log_prior, abs=1e-9)
    np.testing.assert_array_equal(kept[2], chain.beams.ray)
    np.testing.assert_array_equal(kept[3], chain.cones.pose)
    np.testing.assert_array_equal(edges, chain.beams.impact_edge)
    assert turns.state.sums[LOG_POSE_PRIOR] == turns.log_prior
