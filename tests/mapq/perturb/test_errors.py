from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.configuration import MergeSettings, PerturbSettings
from mapq.perturb import build, displaced
from mapq.posed import drive_passes
from mapq.posed.merge import cell_keys, merge
from prf.shell.errors import InputError
from tests.mapq.factories import wall
from tests.mapq.perturb.scenes import look, make_scans, pose_at

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
    moved = displaced(STRAIGHT, PerturbSettings(offset=0.4), 1)
    steps = moved[:, :3, 3] - STRAIGHT[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), [0.0, *[0.4] * 10])
    np.testing.assert_array_equal(steps[:, 2], 0.0)
    np.testing.assert_array_equal(moved[:, :3, :3], STRAIGHT[:, :3, :3])
    assert len(np.unique(np.round(steps[1:, 0], 9))) == 10


def test_a_yaw_turns_scans_about_their_sensors():
    moved = displaced(STRAIGHT, PerturbSettings(yaw=2.0), 3)
    np.testing.assert_allclose(np.abs(yaw_of(moved) - 10.0), [0.0, *[2.0] * 10])
    np.testing.assert_array_equal(moved[:, :3, 3], STRAIGHT[:, :3, 3])


def test_drift_grows_along_the_way_to_its_size():
    moved = displaced(STRAIGHT, PerturbSettings(drift=(1.0, 0.0)), 1)
    apart = np.linalg.norm(moved[:, :3, 3] - STRAIGHT[:, :3, 3], axis=1)
    np.testing.assert_allclose(apart, np.linspace(0.0, 1.0, 11), atol=1e-12)
    turned = displaced(STRAIGHT, PerturbSettings(drift=(0.0, 5.0)), 1)
    np.testing.assert_allclose(np.abs(yaw_of(turned) - 10.0), np.linspace(0.0, 5.0, 11), atol=1e-9)
    # 20 m with a heading that is wrong by 2.5 degrees in the mean.
    assert np.linalg.norm(turned[-1, :3, 3] - STRAIGHT[-1, :3, 3]) == pytest.approx(20 * np.radians(2.5), rel=0.01)
    np.testing.assert_allclose(np.linalg.norm(np.diff(turned[:, :3, 3], axis=0), axis=1), 2.0)


def test_drift_of_a_sensor_that_stands_grows_from_scan_to_scan():
    standing = np.array([pose_at(0.01 * step, 0.0, 30.0 * step) for step in range(5)])
    moved = displaced(standing, PerturbSettings(drift=(1.0, 0.0)), 1)
    apart = np.linalg.norm(moved[:, :3, 3] - standing[:, :3, 3], axis=1)
    np.testing.assert_allclose(apart, np.linspace(0.0, 1.0, 5), atol=1e-12)


def test_a_missed_loop_moves_the_second_pass_as_one():
    poses = round_trip()
    passes = drive_passes(poses)
    begin = int(np.flatnonzero(passes)[0])
    assert 225.0 <= 5.0 * begin <= 240.0
    assert passes.tolist() == [0] * begin + [1] * (len(poses) - begin)
    moved = displaced(poses, PerturbSettings(missed_loop=(0.8, 3.0)), 2)
    np.testing.assert_array_equal(moved[:begin], poses[:begin])
    motion = moved[begin:] @ np.linalg.inv(poses[begin:])
    np.testing.assert_allclose(motion, np.broadcast_to(motion[0], motion.shape), atol=1e-9)
    assert np.linalg.norm(moved[begin, :3, 3] - poses[begin, :3, 3]) == pytest.approx(0.8)
    assert abs(yaw_of(moved)[begin]) == pytest.approx(3.0)


def test_without_a_revisit_a_missed_loop_moves_the_second_half():
    moved = displaced(STRAIGHT, PerturbSettings(missed_loop=(0.5, 0.0)), 2)
    assert (np.linalg.norm(moved[:, :3, 3] - STRAIGHT[:, :3, 3], axis=1) > 0.1).tolist() == [False] * 6 + [True] * 5
    np.testing.assert_array_equal(displaced(STRAIGHT[:1], PerturbSettings(missed_loop=(0.5, 0.0)), 2), STRAIGHT[:1])


def test_the_same_seed_gives_the_same_poses_and_kinds_of_error_do_not_change_each_other():
    both = displaced(STRAIGHT, PerturbSettings(offset=0.3, yaw=1.0), 5)
    np.testing.assert_array_equal(both, displaced(STRAIGHT, PerturbSettings(offset=0.3, yaw=1.0), 5))
    np.testing.assert_array_equal(both[:, :3, 3], displaced(STRAIGHT, PerturbSettings(offset=0.3), 5)[:, :3, 3])
    np.testing.assert_array_equal(both[:, :3, :3], displaced(STRAIGHT, PerturbSettings(yaw=1.0), 5)[:, :3, :3])
    assert not np.array_equal(both, displaced(STRAIGHT, PerturbSettings(offset=0.3, yaw=1.0), 6))
    np.testing.assert_allclose(displaced(STRAIGHT, PerturbSettings(), 5), STRAIGHT, atol=1e-12)


POSES = [pose_at(3.0, -4.0), pose_at(5.0, -4.0, 30.0)]


def two_scans(density=40.0):
    return make_scans([look([wall((0.0, 0.0), (8.0, 0.0))], pose, k, density) for k, pose in enumerate(POSES)], POSES)


def with_clouds(scans, clouds):
    return replace(scans, load=clouds.__getitem__)


def test_all_points_land_where_the_poses_put_them():
    scans = two_scans()
    merged = merge(scans)
    assert merged.counts.tolist() == [len(scans.read(0)), len(scans.read(1))]
    assert np.abs(merged.placed(scans.poses)[:, 1]).max() < 0.05
    np.testing.assert_array_equal(merged.xyz[: len(scans.read(0))], scans.read(0).xyz)


def test_one_point_of_a_scan_is_kept_in_each_cube():
    scans = two_scans(400.0)
    thinned = merge(scans, MergeSettings(voxel=0.25))
    assert len(thinned.xyz) < 0.2 * len(merge(scans).xyz)
    for scan in (0, 1):
        points = thinned.xyz[thinned.scan == scan]
        assert len(np.unique(cell_keys(points, 0.25))) == len(points)
    np.testing.assert_array_equal(thinned.xyz, merge(scans, MergeSettings(voxel=0.25)).xyz)


def test_ranges_and_points_without_a_return():
    scans = two_scans()
    cloud = scans.read(0)
    cloud.xyz[0], cloud.xyz[1] = np.nan, 0.0
    merged = merge(scans, MergeSettings(max_range=5.0))
    assert np.linalg.norm(merged.xyz, axis=1).max() <= 5.0
    assert np.linalg.norm(merged.xyz, axis=1).min() > 0.01
    with pytest.raises(InputError, match="made: no point is left of 2560"):
        merge(scans, MergeSettings(max_range=0.5))


def test_a_field_that_not_all_scans_have_is_dropped_with_a_warning(caplog):
    scans = two_scans()
    clouds = [scans.read(0), scans.read(1).with_fields(ring=np.zeros(len(scans.read(1)), np.uint8))]
    merged = merge(with_clouds(scans, clouds))
    assert list(merged.fields) == ["intensity"]
    assert "field ring is dropped" in caplog.text


def test_fields_of_the_scans_that_bear_our_names_are_kept_under_another():
    scans = two_scans()
    clouds = [scans.read(k).with_fields(scan=np.full(len(scans.read(k)), 9.0)) for k in (0, 1)]
    fields = build(with_clouds(scans, clouds), reference=scans.poses).cloud.fields
    assert (fields["original_scan"] == 9.0).all()
    assert set(fields["scan"].tolist()) == {0, 1}


def test_coordinates_of_a_survey_lose_nothing():
    scans = two_scans()
    far = scans.poses.copy()
    far[:, :3, 3] += (456_000.0, 5_432_000.0, 120.0)
    here, there = (build(scans.with_poses(poses, ""), reference=poses).cloud for poses in (scans.poses, far))
    np.testing.assert_allclose(there.world() - far[0, :3, 3], here.world() - scans.poses[0, :3, 3], atol=1e-5)
    np.testing.assert_array_equal(there.fields["suspicious"], here.fields["suspicious"])
    np.testing.assert_allclose(there.fields["to_sensor_x"], here.fields["to_sensor_x"], atol=1e-5)
