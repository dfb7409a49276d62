"""Labels where no poses are known to be right: pieces of scans are registered to each other."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb import build
from mapq.perturb.measure import measured_disagreement
from mapq.posed import MergeSettings
from mapq.posed.merge import merge
from tests.mapq.factories import Rectangle, wall
from tests.mapq.perturb.scenes import COURT, look, make_scans, pose_at

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
    found = measured_disagreement(merge(scans), np.array(used), sided=sided)
    across_x, across_y, ground = faces(np.concatenate(points))
    where = np.concatenate(points)
    turn = np.radians(yaw)
    expected_x = np.abs(dx - np.sin(turn) * (where[:, 1] - 8.0) + (np.cos(turn) - 1.0) * (where[:, 0] - 14.0))
    expected_y = np.abs(np.sin(turn) * (where[:, 0] - 14.0) + (np.cos(turn) - 1.0) * (where[:, 1] - 8.0))
    assert np.isfinite(found.metres[across_x | across_y]).mean() > 0.97
    for rows, expected in ((across_x, expected_x), (across_y, expected_y)):
        error = np.abs(found.metres - expected)[rows]
        assert np.nanquantile(error, 0.97) < 0.05
    assert np.isnan(found.metres[ground]).mean() > 0.97


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
    built = build(make_scans(points, POSES), settings=MergeSettings(max_range=30.0))
    assert built.report["n_suspicious"] == 0
    merged = merge(make_scans([points[0], points[1][:0]], POSES))
    assert np.isfinite(measured_disagreement(merged, np.array(POSES)).metres).any()
