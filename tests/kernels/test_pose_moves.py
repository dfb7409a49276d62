"""Moves of poses on a map that stays: each is undone by its opposite and keeps volume."""

from __future__ import annotations

import math
from unittest import mock

import numpy as np
import pytest

from prf.kernels.poses import moves as p
from prf.kernels.poses.state import Poses
from tests.reference.pose_worlds import BARE, DRIVEN, begin, draw_pose_world

pytestmark = pytest.mark.uncompiled

MANY = BARE._replace(n=4)
BOTH_WAYS = pytest.mark.parametrize("kind", ["shift", "bend by a turn", "bend by a shift"])


def propose(state: Poses, kind: str, motion: np.ndarray, ends: tuple[int, int]) -> np.ndarray:
    """The poses that a stretch moved by a given motion would come to."""

    def drawn(poses: Poses, i: int, scale: float, rng: object, out: np.ndarray) -> None:
        out[:3] = motion

    class Coin:
        def random(self) -> float:
            return 0.0 if kind == "bend by a turn" else 0.9

    found = []
    with (
        mock.patch.object(p, "spread_of", drawn),
        mock.patch.object(p, "draw_stretch", return_value=ends),
        mock.patch.object(p, "random_scale", return_value=1.0),
        mock.patch.object(p, "decide", lambda chain, poses, low, high, ratio, rng: found.append((low, high, ratio))),
    ):
        p.move_stretch(None, state, kind != "shift", Coin())
    assert found == [(*ends, 0.0)]
    return state.new_pose[ends[0] : ends[1] + 1].copy()


@BOTH_WAYS
@pytest.mark.parametrize("ends", [(0, 3), (1, 3), (1, 2)])
def test_a_stretch_is_led_back_by_the_opposite_and_keeps_volume(kind: str, ends: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    _, turns = begin(draw_pose_world(MANY, rng))
    state, motion = turns.state, np.array([0.3, -0.2, 0.7])
    before, stretch = state.pose.copy(), slice(ends[0], ends[1] + 1)
    there = propose(state, kind, motion, ends)
    state.pose[stretch] = there
    np.testing.assert_allclose(propose(state, kind, -motion, ends), before[stretch], atol=1e-14)
    columns = []
    for k in range(3 * len(there)):
        step = np.zeros(3 * len(there))
        step[k] = 1e-6
        both = []
        for sign in (1.0, -1.0):
            state.pose[:] = before
            state.pose[stretch] += sign * step.reshape(-1, 3)
            both.append(propose(state, kind, motion, ends).ravel())
        columns.append((both[0] - both[1]) / 2e-6)
    assert np.linalg.det(np.array(columns)) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(there - before[stretch]).max() > 0.1


def test_stretches_are_drawn_alike_wherever_they_are() -> None:
    """Their place is uniform given their length; the first pose stays where nothing else fixes the frame."""
    rng = np.random.default_rng(2)
    for rig, first in ((MANY, 0), (DRIVEN._replace(n=4), 1)):
        _, turns = begin(draw_pose_world(rig, rng))
        assert p.first_free(turns.state) == first
        drawn = np.array([p.draw_stretch(turns.state, rng) for _ in range(4000)])
        assert drawn.min() == first
        assert drawn.max() == 3
        for length in range(2, 5 - first):
            low = drawn[np.diff(drawn, axis=1)[:, 0] == length - 1, 0]
            places = np.bincount(low - first, minlength=5 - first - length)
            mean = len(low) / len(places)
            # 4.5 standard deviations: by chance once in 147,000, four numbers at most.
            assert np.abs(places - mean).max() < 4.5 * math.sqrt(mean) + 1e-9
