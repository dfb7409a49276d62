"""Worlds of the joint law of map, poses and readings; moves of poses: what must not change in the mean is compared.

As in :mod:`tests.statistical.joint` each trial is independent and needs no exploration of a posterior.
``python -m tests.statistical.pose_trials RIG TRIALS SEED WARPS`` prints the z-scores as JSON.
"""

from __future__ import annotations

import json
import sys
from unittest import mock

import numpy as np
from numpy.typing import NDArray

import prf
from prf.kernels import constants as c
from prf.kernels.poses.state import POSE_MOVES
from prf.kernels.state.chain import Chain
from prf.model import layout
from prf.model.coloring import Draws, black_areas, black_at
from prf.model.layout import read_coloring
from prf.poses.plane import seen_from, wrapped
from prf.sampler.bends import Fields
from prf.sampler.poses import PoseTurns
from tests.reference import pose_worlds
from tests.reference.pose_worlds import PoseWorld, Rig, begin, draw_pose_world
from tests.statistical.joint import changes, z_of_changes

STEPS = 100
"""Of poses in a trial."""
SPREAD = np.array([0.05, 0.0, 0.05, 0.0, 0.0, 0.05])
"""Root of what poses are taken to vary by. It must not depend on the world."""
N_PLACES = 6
BENDS = Fields(np.array([-1.0, -1.0, 1.5]), np.random.default_rng(1).normal(0.0, 0.15, (3, 8, 8, 2)))
"""Along which map and poses bend together. They must not depend on the world."""


def values(chain: Chain, turns: PoseTurns, world: PoseWorld) -> dict[str, float]:
    """What is compared. Means of the map and of each pose, and of how they hang together."""
    graph, pose, model = chain.graph, turns.state.pose, world.model
    coloring = read_coloring(graph)
    offset = pose - model.prior.given
    offset[:, 2] = wrapped(offset[:, 2])
    named = {
        "length": graph.sums[c.TOTAL_LENGTH],
        "log prior": graph.sums[c.LOG_PRIOR],
        "shortest edge": np.log(coloring.edge_lengths().min(initial=1.0)),
        "log likelihood": graph.sums[c.LOG_LIKELIHOOD],
        "log prior of poses": turns.log_prior,
        "black area": black_areas(Draws.from_colorings([coloring]))[0],
        "vertices near": float((np.hypot(*(coloring.xy - 3.0).T) < 0.8).sum()),
        "vertices about": float((np.hypot(*(coloring.xy - 3.0).T) < 1.6).sum()),
    }
    places = np.random.default_rng(0).uniform(2.0, 4.0, (N_PLACES, 2))
    named |= {f"colour {k}": float(black) for k, black in enumerate(black_at(coloring, places))}
    for name, table in (("pose", offset), ("step", seen_from(pose[:-1], pose[1:]))):
        named |= {f"{name} {i} {axis}": table[i, k] for i in range(len(table)) for k, axis in enumerate("xyt")}
        named |= {f"{name} {i} {axis}²": table[i, k] ** 2 for i in range(len(table)) for k, axis in enumerate("xyt")}
    return {name: float(value) for name, value in named.items()}


def trials(rig: Rig, n: int, seed: int, warps: float, steps: int = STEPS) -> tuple[dict[str, float], dict[str, int]]:
    """z-scores of the mean changes by name, and how many moves of each kind were accepted."""
    accepted, names = np.zeros(len(POSE_MOVES), np.int64), []

    def change(rng: np.random.Generator) -> NDArray[np.float64]:
        nonlocal accepted, names
        # Births alone look at targets, and to find those near each other takes most of the time.
        with mock.patch.object(layout, "NEAR", 0):
            world = draw_pose_world(rig, rng)
            chain, turns = begin(world)
        turns.state.spread[:] = SPREAD
        turns.warps = warps
        turns.bend(BENDS)
        before = values(chain, turns, world)
        after = values(turns.move(chain, rng, steps), turns, world)
        accepted, names = accepted + turns.state.outcomes[:, c.ACCEPTED], list(before)
        return np.array(list(after.values())) - list(before.values())

    z = z_of_changes(changes(change, n, seed)).tolist()
    return dict(zip(names, z, strict=True)), dict(zip(POSE_MOVES, accepted.tolist(), strict=True))


if __name__ == "__main__":
    z, accepted = trials(getattr(pose_worlds, sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
    print(json.dumps({"package": prf.__file__, "z": z, "accepted": accepted}))
