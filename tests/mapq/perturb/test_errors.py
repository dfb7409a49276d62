from __future__ import annotations

import numpy as np
import pytest

from mapq.perturb import PoseErrors, displaced
from mapq.posed import drive_passes
from prf.shell.errors import UsageError
from tests.mapq.perturb.scenes import pose_at

STRAIGHT = np.array([pose_at(2.0 * step, 0.0, 10.0) for step in range(11)])


def yaw_of(poses):
    return np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))


def round_trip():
    """A square of 60 m side, driven one time and a half."""
    corners = np.array([(0, 0), (60, 0), (60, 60), (0, 60), (0, 0), (60, 0), (60, 60)], float)
    way = np.arange(0.0, 360.0, 5.0)
    sides = np.minimum((way // 60).astype(int), 5)
    share = (way - 60 * sides)[:, None] / 60
    places = corners[sides] * (1 - share) + corners[sides + 1] * share
    return np.array([pose_at(x, y) for x, y in places])


def test_an_offset_displaces_every_scan_but_the_first_by_its_size():
    moved = displaced(STRAIGHT, PoseErrors(offset=0.4), 1)
    steps = moved[:, :3, 3] - STRAIGHT[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), [0.0, *[0.4] * 10])
    np.testing.assert_array_equal(steps[:, 2], 0.0)
    np.testing.assert_array_equal(moved[:, :3, :3], STRAIGHT[:, :3, :3])
    assert len(np.unique(np.round(steps[1:, 0], 9))) == 10


def test_a_yaw_turns_scans_about_their_sensors():
    moved = displaced(STRAIGHT, PoseErrors(yaw=2.0), 3)
    np.testing.assert_allclose(np.abs(yaw_of(moved) - 10.0), [0.0, *[2.0] * 10])
    np.testing.assert_array_equal(moved[:, :3, 3], STRAIGHT[:, :3, 3])


def test_drift_grows_along_the_way_to_its_size():
    moved = displaced(STRAIGHT, PoseErrors(drift=(1.0, 0.0)), 1)
    apart = np.linalg.norm(moved[:, :3, 3] - STRAIGHT[:, :3, 3], axis=1)
    np.testing.assert_allclose(apart, np.linspace(0.0, 1.0, 11), atol=1e-12)
    turned = displaced(STRAIGHT, PoseErrors(drift=(0.0, 5.0)), 1)
    np.testing.assert_allclose(np.abs(yaw_of(turned) - 10.0), np.linspace(0.0, 5.0, 11), atol=1e-9)
    # 20 m with a heading that is wrong by 2.5 degrees in the mean.
    assert np.linalg.norm(turned[-1, :3, 3] - STRAIGHT[-1, :3, 3]) == pytest.approx(20 * np.radians(2.5), rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(np.diff(turned[:, :3, 3], axis=0), axis=1), 2.0)


def test_drift_of_a_sensor_that_stands_grows_from_scan_to_scan():
    standing = np.array([pose_at(0.01 * step, 0.0, 30.0 * step) for step in range(5)])
    moved = displaced(standing, PoseErrors(drift=(1.0, 0.0)), 1)
    apart = np.linalg.norm(moved[:, :3, 3] - standing[:, :3, 3], axis=1)
    np.testing.assert_allclose(apart, np.linspace(0.0, 1.0, 5), atol=1e-12)


def test_a_missed_loop_moves_the_second_pass_as_one():
    poses = round_trip()
    passes = drive_passes(poses)
    begin = int(np.flatnonzero(passes)[0])
    assert 225.0 <= 5.0 * begin <= 240.0
    assert passes.tolist() == [0] * begin + [1] * (len(poses) - begin)
    moved = displaced(poses, PoseErrors(missed_loop=(0.8, 3.0)), 2)
    np.testing.assert_array_equal(moved[:begin], poses[:begin])
    motion = moved[begin:] @ np.linalg.inv(poses[begin:])
    np.testing.assert_allclose(motion, np.broadcast_to(motion[0], motion.shape), atol=1e-9)
    assert np.linalg.norm(moved[begin, :3, 3] - poses[begin, :3, 3]) == pytest.approx(0.8)
    assert abs(yaw_of(moved)[begin]) == pytest.approx(3.0)


def test_without_a_revisit_a_missed_loop_moves_the_second_half():
    moved = displaced(STRAIGHT, PoseErrors(missed_loop=(0.5, 0.0)), 2)
    assert (np.linalg.norm(moved[:, :3, 3] - STRAIGHT[:, :3, 3], axis=1) > 0.1).tolist() == [False] * 6 + [True] * 5
    np.testing.assert_array_equal(displaced(STRAIGHT[:1], PoseErrors(missed_loop=(0.5, 0.0)), 2), STRAIGHT[:1])


def test_the_same_seed_gives_the_same_poses_and_kinds_of_error_do_not_change_each_other():
    both = displaced(STRAIGHT, PoseErrors(offset=0.3, yaw=1.0), 5)
    np.testing.assert_array_equal(both, displaced(STRAIGHT, PoseErrors(offset=0.3, yaw=1.0), 5))
    np.testing.assert_array_equal(both[:, :3, 3], displaced(STRAIGHT, PoseErrors(offset=0.3), 5)[:, :3, 3])
    np.testing.assert_array_equal(both[:, :3, :3], displaced(STRAIGHT, PoseErrors(yaw=1.0), 5)[:, :3, :3])
    assert not np.array_equal(both, displaced(STRAIGHT, PoseErrors(offset=0.3, yaw=1.0), 6))
    np.testing.assert_allclose(displaced(STRAIGHT, PoseErrors(), 5), STRAIGHT, atol=1e-12)


@pytest.mark.parametrize(
    ("errors", "flag"),
    [
        (PoseErrors(offset=-1.0), "--offset"),
        (PoseErrors(yaw=np.nan), "--yaw"),
        (PoseErrors(drift=(0.0, np.inf)), "--drift"),
        (PoseErrors(missed_loop=(1e5, 0.0)), "--missed-loop"),
    ],
)
def test_sizes_outside_their_domains_are_refused(errors, flag):
    with pytest.raises(UsageError, match=flag):
        displaced(STRAIGHT, errors, 0)
