"""Labels where the right poses are known: two passes along walls, and what must not be taken for an error."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.configuration import MergeSettings, PerturbSettings
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb import build
from mapq.perturb.known import find_surfaces, known_disagreement
from mapq.perturb.measure import measured_disagreement
from mapq.posed.merge import merge
from tests.mapq.factories import Rectangle, wall
from tests.mapq.perturb.scenes import COURT, look, make_scans, pose_at, rings
from tests.reference.mapq_perturb import brute_disagreement

LONG = wall((0.0, 0.0), (12.0, 0.0))
PASSES = (pose_at(4.0, -5.0), pose_at(8.0, -6.0, 90.0))


def moved_by(poses, scan, dx=0.0, dy=0.0):
    used = np.array(poses)
    used[scan, :2, 3] += dx, dy
    return used


def labels_of(points, poses, used, **settings):
    """Return label and disagreement of each point, scan by scan, if `poses` are right and `used` are used."""
    scans = make_scans(points, list(used))
    for number, (seen, pose) in enumerate(zip(points, poses, strict=True)):
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        scans.load(number).xyz[:] = local
    built = build(scans, reference=np.array(poses), merging=MergeSettings(**settings))
    fields = built.cloud.fields
    ends = np.cumsum([len(seen) for seen in points])[:-1]
    return np.split(fields["suspicious"], ends), np.split(fields["disagreement"], ends), built


@pytest.mark.parametrize(
    ("offset", "label"), [(0.05, PLAUSIBLE), (0.2, UNLABELLED), (0.5, SUSPICIOUS), (-0.5, SUSPICIOUS)]
)
def test_two_passes_displaced_along_the_normal(offset, label):
    points = [look([LONG], pose, number) for number, pose in enumerate(PASSES)]
    labels, metres, _ = labels_of(points, PASSES, moved_by(PASSES, 1, dy=offset))
    for each, apart in zip(labels, metres, strict=True):
        np.testing.assert_array_equal(each, label)
        np.testing.assert_allclose(apart, abs(offset), atol=0.02)


def test_a_displacement_along_the_wall_shows_nowhere():
    points = [look([LONG], pose, number) for number, pose in enumerate(PASSES)]
    labels, metres, _ = labels_of(points, PASSES, moved_by(PASSES, 1, dx=0.9))
    assert all((each == PLAUSIBLE).all() for each in labels)
    assert max(apart.max() for apart in metres) < 0.05


def test_what_one_scan_alone_saw_is_plausible_however_wrong():
    other = wall((0.0, 6.0), (12.0, 6.0))
    points = [look([LONG], PASSES[0], 1), look([other], PASSES[1], 2)]
    labels, metres, built = labels_of(points, PASSES, moved_by(PASSES, 1, dy=2.0))
    assert all((each == PLAUSIBLE).all() for each in labels)
    assert all((apart == 0.0).all() for apart in metres)
    assert built.report["n_seen_once"] == built.report["n_points"]


@pytest.mark.parametrize("thickness", [0.04, 0.1, 0.2, 0.3])
def test_the_two_sides_of_a_wall_are_two_surfaces(thickness):
    south, north = wall((0.0, 0.0), (12.0, 0.0)), wall((0.0, thickness), (12.0, thickness))
    poses = [pose_at(5.0, -5.0), pose_at(6.0, 5.0)]
    points = [look([south], poses[0], 1), look([north], poses[1], 2)]
    labels, _, _ = labels_of(points, poses, moved_by(poses, 1, dy=0.6))
    # Single cells of a wall as thin as the noise of their planes have none, so nothing is known of them.
    assert all((each != SUSPICIOUS).all() and (each == PLAUSIBLE).mean() > 0.85 for each in labels)


def test_sub_maps_tell_a_thick_wall_from_a_doubled_one_but_have_no_sides():
    thick = [wall((0.0, y), (12.0, y)) for y in (0.0, 0.3)]
    points = [look([one], PASSES[number], number) for number, one in enumerate(thick)]
    labels, _, built = labels_of(points, PASSES, moved_by(PASSES, 1, dy=0.6), submaps=True)
    assert all((each == PLAUSIBLE).all() for each in labels)
    assert not {"pass_id", "to_sensor_x"} & set(built.cloud.fields)


def test_sparse_rings_of_two_scans_still_meet():
    points = [rings(LONG, 0.2, 0.7, 1), rings(LONG, 0.55, 0.7, 2)]
    labels, metres, built = labels_of(points, PASSES, moved_by(PASSES, 1, dy=0.5))
    assert built.report["reach"] >= 0.4
    for each, apart in zip(labels, metres, strict=True):
        assert (each == SUSPICIOUS).mean() > 0.95
        assert abs(np.nanmedian(apart) - 0.5) < 0.02


def test_the_whole_frame_may_be_moved_and_turned():
    points = [look([LONG], pose, number) for number, pose in enumerate(PASSES)]
    used = pose_at(300.0, -200.0, 77.0, 5.0) @ moved_by(PASSES, 1, dy=0.05)
    labels, metres, _ = labels_of(points, PASSES, used)
    assert all((each == PLAUSIBLE).all() for each in labels)
    assert max(apart.max() for apart in metres) < 0.06


def test_of_three_scans_the_range_counts_for_all():
    poses = [*PASSES, pose_at(6.0, -4.0)]
    points = [look([LONG], pose, number) for number, pose in enumerate(poses)]
    used = moved_by(moved_by(poses, 1, dy=0.05), 2, dy=0.5)
    _, metres, _ = labels_of(points, poses, used)
    for apart in metres:
        np.testing.assert_allclose(apart, 0.5, atol=0.02)


def test_where_there_is_no_plane_only_agreement_is_known():
    rng = np.random.default_rng(4)
    bush = [rng.normal((5.0, 0.0, 2.0), 0.8, (3000, 3)) for _ in PASSES]
    agreeing, _, _ = labels_of(bush, PASSES, moved_by(PASSES, 1, dy=0.05))
    assert all((each == PLAUSIBLE).mean() > 0.99 for each in agreeing)
    displaced, _, _ = labels_of(bush, PASSES, moved_by(PASSES, 1, dy=0.5))
    assert all((each == UNLABELLED).mean() > 0.7 for each in displaced)


def test_a_turned_scan_disagrees_by_what_its_yaw_makes_at_each_place():
    points = [look([LONG], pose, number) for number, pose in enumerate(PASSES)]
    used = np.array(PASSES)
    used[1] = pose_at(8.0, -6.0, 95.0)
    _, metres, built = labels_of(points, PASSES, used)
    arm = points[0][:, 0] - 8.0
    expected = np.abs(arm * np.sin(np.radians(5.0)) + 6.0 * (np.cos(np.radians(5.0)) - 1.0))
    np.testing.assert_allclose(metres[0], expected, atol=0.06)
    assert built.report["labels_from"] == "reference poses"


def test_agrees_with_brute_force_over_all_points():
    poses = [pose_at(4.0, -5.0), pose_at(8.0, -6.0), pose_at(6.0, 6.0), pose_at(2.0, -3.0)]
    walls = [LONG, wall((0.0, 0.1), (12.0, 0.1)), wall((12.0, -8.0), (12.0, 0.0))]
    seen = [[walls[0], walls[2]], [walls[0]], [walls[1]], [walls[2]]]
    points = [look(each, pose, number, 25.0) for number, (each, pose) in enumerate(zip(seen, poses, strict=True))]
    used = moved_by(moved_by(poses, 1, dy=0.3), 3, dx=0.4)
    merged = merge(make_scans(points, poses))
    found, n_found = known_disagreement(find_surfaces(merged, np.array(poses), 0.6), np.array(poses), used, 0.1)
    normals = [np.where(np.abs(each[:, :1] - 12.0) < 0.05, [[-1.0, 0, 0]], [[0, -1.0, 0]]) for each in points]
    normals[2] = -normals[2]
    metres, n_others = brute_disagreement(points, normals, np.array(poses), used, 0.6)
    # Elements are a quarter of a metre wide: near ends and corners of walls they see as far, or not.
    same = (n_found > 0) == (n_others > 0)
    assert same.mean() > 0.97
    inside = same & np.isfinite(found)
    assert inside.mean() > 0.9
    assert (np.abs(found - metres)[inside] < 0.03).mean() > 0.97


def test_points_keep_what_they_had_and_get_rays_scans_passes_and_times():
    points = [look([LONG], pose, number) for number, pose in enumerate(PASSES)]
    scans = make_scans(points, PASSES, np.array([10.0, 11.5]))
    built = build(scans, settings=PerturbSettings(), reference=scans.poses)
    fields = built.cloud.fields
    np.testing.assert_array_equal(fields["scan"], np.repeat([0, 1], [len(each) for each in points]))
    assert fields["scan"].dtype == np.int32
    ray = np.column_stack([fields[f"to_sensor_{axis}"] for axis in "xyz"])
    origin = np.array(PASSES)[fields["scan"], :3, 3]
    np.testing.assert_allclose(built.cloud.world() + ray, origin, atol=1e-5)
    np.testing.assert_allclose(built.cloud.world(), np.concatenate(points), atol=1e-5)
    assert sorted(set(fields["time"].tolist())) == [10.0, 11.5]
    assert set(fields["pass_id"].tolist()) == {0}
    assert fields["intensity"][:5].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert [row["name"] for row in built.report["scans"]] == ["scan 0", "scan 1"]


# Labels where no poses are known to be right: pieces of scans are registered to each other.


POSES = [pose_at(6.0, 5.0), pose_at(14.0, 8.0, 90.0)]


def court(used, walls=COURT, density=20.0):
    points = [look(walls, pose, number, density) for number, pose in enumerate(POSES)]
    return points, make_scans(points, POSES).with_poses(np.array(used), "used")


def faces(points):
    """Return which points lie on walls across x, on walls across y, and on the ground, away from edges."""
    ground = points[:, 2] < 0.1
    inner = points[:, 2] > 0.4
    across_x = inner & (np.minimum(np.abs(points[:, 0]), np.abs(points[:, 0] - 20.0)) < 0.1)
    across_y = inner & (np.minimum(np.abs(points[:, 1]), np.abs(points[:, 1] - 14.0)) < 0.1)
    corner = (np.abs(points[:, 0] - 10.0) > 9.3) & (np.abs(points[:, 1] - 7.0) > 6.3)
    return across_x & ~corner, across_y & ~corner, ground


@pytest.mark.parametrize(("sided", "dx", "yaw"), [(True, 0.6, 0.0), (False, -1.5, 0.0), (True, 0.0, 2.0)])
def test_the_displacement_is_found_where_it_shows(sided, dx, yaw):
    used = [POSES[0], pose_at(14.0 + dx, 8.0, 90.0 + yaw)]
    points, scans = court(used)
    found, _ = measured_disagreement(merge(scans), np.array(used), sided=sided)
    across_x, across_y, ground = faces(np.concatenate(points))
    where = np.concatenate(points)
    turn = np.radians(yaw)
    expected_x = np.abs(dx - np.sin(turn) * (where[:, 1] - 8.0) + (np.cos(turn) - 1.0) * (where[:, 0] - 14.0))
    expected_y = np.abs(np.sin(turn) * (where[:, 0] - 14.0) + (np.cos(turn) - 1.0) * (where[:, 1] - 8.0))
    assert np.isfinite(found[across_x | across_y]).mean() > 0.97
    for rows, expected in ((across_x, expected_x), (across_y, expected_y)):
        error = np.abs(found - expected)[rows]
        assert np.nanquantile(error, 0.97) < 0.05
    assert np.isnan(found[ground]).mean() > 0.97


def test_labels_and_what_they_rest_on():
    points, scans = court([POSES[0], pose_at(14.6, 8.0, 90.0)])
    built = build(scans)
    label = built.cloud.fields["suspicious"]
    across_x, across_y, ground = faces(np.concatenate(points))
    assert (label[across_x] == SUSPICIOUS).mean() > 0.97
    assert (label[across_y] == PLAUSIBLE).mean() > 0.95
    assert (label[ground] == UNLABELLED).mean() > 0.97
    assert built.report["labels_from"] == "registration"
    assert built.report["n_not_known"] >= ground.sum() * 0.97


def test_walls_that_no_other_scan_comes_near_are_plausible():
    far = [wall((60.0, y), (75.0, y), 4.0) for y in (0.0, 9.0)]
    points = [look(COURT, POSES[0], 0, 20.0), look(far, POSES[1], 1, 20.0)]
    built = build(make_scans(points, POSES))
    of_walls = np.concatenate([each[:, 2] > 0.4 for each in points])
    assert (built.cloud.fields["suspicious"][of_walls] == PLAUSIBLE).mean() > 0.97
    assert built.report["n_suspicious"] == 0


def test_near_walls_that_do_not_fit_are_not_known():
    # A row of stubs that stand at right angles to the wall near them: nothing of it overlaps.
    stubs = [wall((x, 0.2), (x, 1.4), 4.0) for x in np.arange(0.5, 20.0, 0.7)]
    points = [look(COURT[:1], POSES[0], 0, 20.0), look(stubs, POSES[1], 1, 20.0)]
    label = build(make_scans(points, POSES)).cloud.fields["suspicious"]
    assert (label == UNLABELLED).mean() > 0.9


def test_what_is_too_small_to_be_registered_is_not_known():
    # A board that both see, 0.6 m apart: too small for a piece, and by itself it was "seen once".
    boards = [Rectangle((5.0, y, 2.0), (1, 0, 0), width=0.8, height=0.8) for y in (4.0, 4.6)]
    points = [look([board, COURT[4]], pose, 3, 400.0) for board, pose in zip(boards, POSES, strict=True)]
    label = build(make_scans(points, POSES)).cloud.fields["suspicious"]
    assert (label[np.concatenate(points)[:, 2] > 0.4] == UNLABELLED).all()


def test_an_empty_scan_and_a_scan_without_walls_are_unknown():
    points = [look(COURT, POSES[0], 0, 20.0), look(COURT[4:], POSES[1], 1, 20.0)]
    built = build(make_scans(points, POSES), merging=MergeSettings(max_range=30.0))
    assert built.report["n_suspicious"] == 0
    merged = merge(make_scans([points[0], points[1][:0]], POSES))
    assert np.isfinite(measured_disagreement(merged, np.array(POSES))[0]).any()
