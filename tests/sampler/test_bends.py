"""The softest directions of map and poses: their normal equations against differences, what they say against chains."""

from __future__ import annotations

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses.state import WARP
from prf.poses.plane import compose
from prf.sampler.bends import N_FIELDS, NO_FIELDS, normal_matrix, soft_fields
from tests.reference.pose_worlds import BOTH, DRIVEN, LASER, Rig, begin, draw_pose_world

RIGS = pytest.mark.parametrize("rig", [LASER, DRIVEN, BOTH], ids=["errors", "odometry", "both"])


def misfits(chain, state, prior, poses, xy) -> np.ndarray:  # type: ignore[no-untyped-def]
    """What readings and the prior have against poses and places of vertices, in standard deviations."""
    graph, beams = chain.graph, chain.beams
    found = []
    for i in range(len(poses)):
        for at in range(state.beam_start[i], state.beam_start[i + 1]):
            beam = state.beam_of[at]
            edge, ray = beams.impact_edge[beam], beams.ray[beam]
            if edge == c.NONE or not (np.isfinite(ray[c.RANGE]) and ray[c.RANGE] >= 0.0):
                continue
            (ax, ay), (bx, by) = (xy[v] for v in graph.edge_vertices[edge])
            cosine, sine = np.cos(poses[i, 2]), np.sin(poses[i, 2])
            lx, ly, lc, ls = state.beam_local[at]
            ox, oy = poses[i, 0] + cosine * lx - sine * ly, poses[i, 1] + sine * lx + cosine * ly
            ux, uy = cosine * lc - sine * ls, sine * lc + cosine * ls
            across = ux * (by - ay) - uy * (bx - ax)
            distance = ((ax - ox) * (by - ay) - (ay - oy) * (bx - ax)) / across
            model, now = beams.model, ray[c.DISTANCE]
            s = max(model[c.NOISE], model[c.NOISE_RELATIVE] * now)
            hit = model[c.HIT] * np.exp(-0.5 * ((ray[c.RANGE] - now) / s) ** 2) / (s * np.sqrt(2.0 * np.pi))
            found.append(np.sqrt(model[c.WEIGHT] * hit / (hit + model[c.OUTLIER_DENSITY])) * distance / s)
    if not prior.is_held:
        found += list(((poses - prior.given) / prior.noise[:, [0, 0, 1]]).ravel())
    return np.array(found)


@pytest.mark.parametrize("rig", [LASER, BOTH._replace(odometry=None)], ids=["laser", "with sonar"])
def test_the_normal_matrix_is_that_of_differences(rig: Rig) -> None:
    rng, compared = np.random.default_rng(3), 0
    for _ in range(4):
        world = draw_pose_world(rig, rng)
        chain, turns = begin(world)
        state, prior, graph = turns.state, world.model.prior, chain.graph
        vertex, normal = normal_matrix(chain, state, prior)
        n, step, columns = len(state.pose), 1e-6, []
        for k in range(3 * n + 2 * len(vertex)):
            ends = []
            for sign in (step, -step):
                poses, xy = state.pose.copy(), graph.vertex_xy.copy()
                if k < 3 * n:
                    poses[k // 3] = compose(poses[k // 3], sign * np.eye(3)[k % 3])
                else:
                    xy[vertex[(k - 3 * n) // 2], (k - 3 * n) % 2] += sign
                ends.append(misfits(chain, state, prior, poses, xy))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        jacobian = np.array(columns).T
        expected = jacobian.T @ jacobian
        expected[np.arange(3 * n, len(expected)), np.arange(3 * n, len(expected))] += 1.0 / 0.3**2
        if len(jacobian) > 3 * n:
            compared += 1
            np.testing.assert_allclose(normal.toarray(), expected, rtol=1e-5, atol=1e-4 * np.abs(expected).max())
    assert compared > 1


@RIGS
def test_the_fields_of_a_map_are_finite_and_warps_by_them_accepted(rig: Rig) -> None:
    rng = np.random.default_rng(1)
    world = draw_pose_world(rig, rng)
    chain, turns = begin(world)
    turns.measure(chain)
    fields = turns.state.fields
    assert fields.shape[0] == N_FIELDS
    assert np.isfinite(fields).all()
    before = turns.state.outcomes[WARP].copy()
    turns.warps = 0.5
    turns.move(chain, rng, 400)
    proposed, accepted = turns.state.outcomes[WARP, [c.PROPOSED, c.ACCEPTED]] - before[[c.PROPOSED, c.ACCEPTED]]
    assert 0.05 * proposed < accepted < proposed


def test_without_walls_there_is_none() -> None:
    world = draw_pose_world(LASER, np.random.default_rng(1))
    chain, turns = begin(world._replace(coloring=type(world.coloring).empty(world.coloring.window)))
    assert soft_fields(chain, turns.state, world.model.prior) is NO_FIELDS
