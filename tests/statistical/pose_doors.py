"""A door into single moves of poses, and chains of them on a map that is known."""

from __future__ import annotations

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import Rng, core, jit
from prf.kernels.poses.match import match_pose
from prf.kernels.poses.moves import move_pose, move_stretch
from prf.kernels.poses.state import BEND, MATCH, SHIFT, WALK, Poses
from prf.kernels.poses.warp import warp
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph
from tests.reference.pose_worlds import PoseWorld, begin, scratch


@core
def make_moves(
    chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, odds: np.ndarray, kept: np.ndarray, rng: Rng
) -> None:
    for k in range(kept.shape[0]):
        for _ in range(kept.shape[1]):
            u = rng.random()
            move = 0
            while u >= odds[move]:
                u -= odds[move]
                move += 1
            if move == WALK:
                accepted = move_pose(chain, poses, rng)
            elif move == MATCH:
                accepted = match_pose(chain, poses, rng)
            elif move in (SHIFT, BEND):
                accepted = move_stretch(chain, poses, move == BEND, rng)
            else:
                accepted = warp(chain, trial, trial_index, poses, rng)
            poses.outcomes[move, c.ACCEPTED] += accepted
        for i in range(poses.pose.shape[0]):
            for axis in range(3):
                kept[k, 0, i, axis] = poses.pose[i, axis]


@jit
def chain_of_moves(
    chain: Chain, trial: Graph, trial_index: EdgeIndex, poses: Poses, odds: np.ndarray, kept: np.ndarray, rng: Rng
) -> None:
    """Keep the poses (n_kept, every, n, 3) after so many moves each, drawn with the odds (5,); place 0 takes them."""
    make_moves(chain, trial, trial_index, poses, odds, kept, rng)


def sample_poses(
    world: PoseWorld, odds: dict[int, float], n: int, every: int, spread: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (n, n_poses, 3) of a chain of such moves, and how many of each were accepted."""
    chain, turns = begin(world)
    turns.state.spread[:] = spread * np.array([1.0, 0.3, 1.0, 0.0, 0.3, 1.0])
    shares = np.array([odds.get(move, 0.0) for move in range(5)])
    kept = np.zeros((n, every, *world.truth.shape))
    chain_of_moves(chain, *scratch(chain), turns.state, shares / shares.sum() + 1e-12, kept, rng)
    return kept[:, 0], turns.state.outcomes[:, c.ACCEPTED]
