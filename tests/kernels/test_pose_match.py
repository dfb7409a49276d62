"""The proposal of a matched pose: its equations are derivatives, its density that of its draws, its point its own."""

from __future__ import annotations

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.poses import match as m
from tests.reference.pose_worlds import BOTH, DRIVEN, LASER, Rig, begin, draw_pose_world

pytestmark = pytest.mark.uncompiled

RIGS = pytest.mark.parametrize("rig", [LASER, DRIVEN, BOTH], ids=["errors", "odometry", "both"])


def symmetric(rows: np.ndarray) -> np.ndarray:
    """The matrix whose lower triangle is given by rows."""
    full = np.zeros((3, 3))
    full[np.tril_indices(3)] = rows
    return full + np.tril(full, -1).T


@RIGS
def test_the_gradient_of_the_priors_is_a_derivative(rig: Rig) -> None:
    rng = np.random.default_rng(1)
    world = draw_pose_world(rig, rng)
    _, turns = begin(world)
    state, prior = turns.state, world.model.prior
    for i in range(1, rig.n):
        at = world.truth[i] + rng.normal(0.0, 0.1, 3)
        state.work[:] = 0.0
        m.add_priors(state, state.work, at, i)
        poses = state.pose.copy()

        def density(changed: np.ndarray, poses: np.ndarray = poses, i: int = i) -> float:
            poses[i] = changed
            return prior.log_density(poses)

        np.testing.assert_allclose(state.work[m.GRADIENT : m.GRADIENT + 3], slope(density, at), rtol=1e-5, atol=1e-5)


def slope(function, at: np.ndarray) -> np.ndarray:
    """Central differences."""
    steps = 1e-6 * np.eye(3)
    return np.array([(function(at + step) - function(at - step)) / 2e-6 for step in steps])


def test_what_a_beam_adds_are_the_squares_of_derivatives() -> None:
    """Of the range that the edge would give, which `add_beam` knows at one place alone."""
    rng = np.random.default_rng(2)
    model = np.zeros(c.N_LASER_MODEL)
    model[[c.NOISE, c.HIT, c.OUTLIER_DENSITY]] = 0.1, 0.9, 1e-9
    for _ in range(20):
        pose, bearing = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5)
        xy = np.array([2.0, -9.0, 2.0 + rng.uniform(-1.0, 1.0), 9.0])

        def ray_at(pose: np.ndarray, bearing: float = bearing) -> np.ndarray:
            u = np.array([np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)])
            return np.concatenate([pose[:2] + 0.3 * np.array([np.cos(pose[2]), np.sin(pose[2])]), u])

        def distance(pose: np.ndarray, xy: np.ndarray = xy) -> float:
            ox, oy, ux, uy = ray_at(pose)
            ex, ey = xy[2] - xy[0], xy[3] - xy[1]
            return float(((xy[0] - ox) * ey - (xy[1] - oy) * ex) / (ux * ey - uy * ex))

        ray = np.zeros(c.N_RAY)
        ray[:4], ray[c.DISTANCE] = ray_at(pose), distance(pose)
        ray[c.RANGE] = ray[c.DISTANCE] + 0.07
        work = np.zeros(48)
        m.add_beam(model, work, pose, ray, xy, 1.0)
        by_pose = slope(distance, pose)
        np.testing.assert_allclose(
            symmetric(work[m.NORMAL : m.GRADIENT]), 100.0 * np.outer(by_pose, by_pose), rtol=1e-4
        )
        np.testing.assert_allclose(work[m.GRADIENT : m.ROOT], 7.0 * by_pose, rtol=1e-4)


@RIGS
def test_draws_have_the_density_that_the_ratio_takes(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    world = draw_pose_world(rig, rng)
    chain, turns = begin(world)
    state, i = turns.state, 1
    assert m.match(chain.graph, chain.edge_index, chain.beams, state, i)
    root = np.zeros((3, 3))
    root[np.tril_indices(3)] = state.work[m.ROOT : m.STEP]
    np.testing.assert_allclose(root @ root.T, symmetric(state.work[m.NORMAL : m.GRADIENT]), rtol=1e-9)
    mean = state.work[m.MEAN : m.MEAN + 3].copy()
    for _ in range(50):
        normal = rng.standard_normal(3)
        found = np.array(m.solve_root(state.work, *normal))
        np.testing.assert_allclose(root.T @ found, normal, rtol=1e-9, atol=1e-12)
        pose = mean + m.INFLATION * found + [0.0, 0.0, 2.0 * np.pi * rng.integers(-1, 2)]
        assert m.half_square(state, pose) == pytest.approx(0.5 * normal @ normal, rel=1e-9)
    np.testing.assert_allclose(root @ root.T @ m.newton_step(state.work), state.work[m.GRADIENT : m.ROOT], atol=1e-9)


@RIGS
def test_where_a_match_leads_does_not_depend_on_the_pose_that_it_replaces(rig: Rig) -> None:
    world = draw_pose_world(rig, np.random.default_rng(4))
    chain, turns = begin(world)
    found = []
    for offset in (0.0, 0.1, -0.3):
        turns.place(chain, world.truth + offset * np.eye(rig.n)[:, [1]])
        state = turns.state
        state.new_ray[:], state.new_pose[:] = offset, offset
        assert m.match(chain.graph, chain.edge_index, chain.beams, state, 1)
        found.append(state.work[m.NORMAL : m.MEAN + 3].copy())
    np.testing.assert_array_equal(found[1:], [found[0]] * 2)


def test_walks_are_scaled_by_what_a_pose_may_vary_by() -> None:
    world = draw_pose_world(BOTH, np.random.default_rng(5))
    chain, turns = begin(world)
    turns.measure(chain)
    state = turns.state
    for i in range(BOTH.n):
        assert m.gather(chain.graph, chain.edge_index, chain.beams, state, i, state.pose[i], 1.0)
        root = np.zeros((3, 3))
        root[np.tril_indices(3)] = state.spread[i]
        normal = symmetric(state.work[m.NORMAL : m.GRADIENT])
        np.testing.assert_allclose(root @ root.T, np.linalg.inv(normal), rtol=1e-8, atol=1e-14)
