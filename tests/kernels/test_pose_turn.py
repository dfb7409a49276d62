"""Turns of poses: what is added up on the way is what a look at map and poses says, for all sensors and priors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses.state import WARP
from prf.kernels.poses.turn import run_poses
from prf.kernels.state.build import recompute_sums, trace_all
from prf.model.layout import run_chain
from tests.kernels.test_poses import FAR
from tests.reference.chain_state import structural_faults
from tests.reference.pose_worlds import BOTH, DRIVEN, LASER, Rig, begin, draw_pose_world, scratch
from tests.reference.recompute import differences

pytestmark = pytest.mark.uncompiled

SONAR = BOTH._replace(n_beams=0, odometry=None)
RIGS = {"laser": LASER, "sonar": SONAR, "both": BOTH, "odometry": DRIVEN, "beyond the window": FAR}


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
    chain, turns = begin(world._replace(settings=dataclasses.replace(world.settings, resolution=0.5)))
    turns.warps = 0.5
    assert differences(turns.move(chain, rng, 30)) == []
    assert turns.state.outcomes[WARP, c.ACCEPTED] > 0
