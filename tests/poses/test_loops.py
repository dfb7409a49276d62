"""Closures of loops, right and wrong ones."""

from __future__ import annotations

import numpy as np

from prf.poses.graph import Pull, Relations, root_of
from prf.poses.loops import LoopMatch, _settled
from prf.poses.plane import compose, seen_from
from tests.poses.drives import off, round_the_block


def test_a_wrong_loop_is_left_out_and_does_not_fold_the_map():
    truth, rng = round_the_block(), np.random.default_rng(5)
    n = len(truth)
    steps = seen_from(truth[:-1], truth[1:])
    sd = np.array([0.02, 0.02, 0.01])
    tail, motion = np.arange(n - 1), steps + sd * rng.normal(size=steps.shape)
    drifting = [truth[0]]
    for step in motion:
        drifting.append(compose(drifting[-1], step))
    held = np.where(np.arange(n)[:, None] == 0, 1e6, np.zeros((n, 3)))
    root = root_of(np.tile(np.diag(sd**2), (n - 1, 1, 1)))
    chain = Pull(truth, held, Relations(tail, tail + 1, motion, root))
    covariance = np.diag([0.05, 0.05, 0.01]) ** 2
    right = [LoopMatch(k, n - 12 + k, seen_from(truth[k], truth[n - 12 + k]), covariance, 0.8, True) for k in (0, 4, 8)]
    wrong = LoopMatch(2, n // 2, np.array([3.0, 0.5, 0.4]), covariance, 0.7, True)
    poses, found = _settled(np.array(drifting), chain, [*right, wrong])
    assert [match.is_used for match in found] == [True, True, True, False]
    assert off(poses, truth) < 0.6 * off(np.array(drifting), truth)
