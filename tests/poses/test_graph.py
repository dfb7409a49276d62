"""Linear equations of relative poses."""

from __future__ import annotations

import numpy as np

from prf.poses.graph import Pull, Relations, derivatives, errors
from prf.poses.plane import compose, seen_from


def some(rng, n=6, k=9):
    poses = rng.normal(size=(n, 3)) * [3.0, 3.0, 2.0]
    tail = rng.integers(0, n, k)
    head = (tail + rng.integers(1, n, k)) % n
    return poses, Relations(tail, head, rng.normal(size=(k, 3)), rng.normal(size=(k, 3, 3)))


def test_derivatives_are_those_of_the_errors():
    poses, relations = some(np.random.default_rng(1))
    step = 1e-6
    for sides, found in zip((relations.tail, relations.head), derivatives(relations, poses), strict=True):
        for axis in range(3):
            change = []
            for sign in (-1.0, 1.0):
                moved = poses[sides]
                moved = compose(moved, np.eye(3)[axis] * sign * step)
                both = [poses[relations.tail], poses[relations.head]]
                both[0 if sides is relations.tail else 1] = moved
                error = seen_from(*both) - relations.pose
                change.append(np.einsum("kij,kj->ki", relations.root, error))
            np.testing.assert_allclose(found[:, :, axis], (change[1] - change[0]) / (2.0 * step), atol=1e-7)


def test_equations_lead_down_to_the_poses_of_exact_relations():
    rng = np.random.default_rng(2)
    poses, relations = some(rng, k=20)
    exact = relations._replace(pose=seen_from(poses[relations.tail], poses[relations.head]))
    pull = Pull(poses, np.where(np.arange(6)[:, None] == 0, 10.0, np.zeros((6, 3))), exact)
    found = compose(poses, 0.05 * rng.normal(size=poses.shape))
    for _ in range(8):
        matrix, right = pull.equations(found)
        found = compose(found, np.linalg.solve(matrix.toarray(), right).reshape(-1, 3))
    np.testing.assert_allclose(errors(exact, found), 0.0, atol=1e-8)
    np.testing.assert_allclose(found, poses, atol=1e-8)
