"""Turns of a chain in which its poses move, and at times its map with them; the map alone moves in between."""

from prf.kernels import constants as c
from prf.kernels._jit import Rng, core, jit
from prf.kernels.poses.match import match_pose
from prf.kernels.poses.moves import move_pose, move_stretch
from prf.kernels.poses.state import BEND, MATCH, SHIFT, WALK, WARP, Poses
from prf.kernels.poses.warp import warp
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph


@core
def choose(poses: Poses, warps: float, rng: Rng) -> int:
    """Draw a move: warps with a probability, the others as often as they pay."""
    u = rng.random()
    if u < warps:
        return WARP
    u = (u - warps) / (1.0 - warps)
    if u < 0.1 and poses.beam_of.shape[0] > 0:
        return MATCH
    if u < 0.16:
        return SHIFT
    return BEND if u < 0.22 else WALK


@core
def pose_steps(
    chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, warps: float, until: int, rng: Rng
) -> None:
    """The loop of :func:`run_poses`."""
    counts = chain.graph.counts
    while counts[c.STEP] < until:
        counts[c.STEP] += 1
        move = choose(poses, warps, rng)
        if move == WARP:
            accepted = warp(chain, trial, trial_index, poses, rng)
        elif move == MATCH:
            accepted = match_pose(chain, poses, rng)
        elif move == WALK:
            accepted = move_pose(chain, poses, rng)
        else:
            accepted = move_stretch(chain, poses, move == BEND, rng)
        poses.outcomes[move, c.PROPOSED] += 1
        if accepted:
            poses.outcomes[move, c.ACCEPTED] += 1


@jit
def run_poses(
    chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, warps: float, until: int, rng: Rng
) -> None:
    """Move poses until the step counter reaches `until`; a share `warps` of the proposals moves the map with them.

    Lists of beams, cones and sensors do not follow: they must be made anew before the map moves again.
    """
    pose_steps(chain, trial, trial_index, poses, warps, until, rng)
