from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mapq.configuration import FindSettings, ReadOptions
from mapq.posed import drive_passes, find_scans
from mapq.posed.poses import laser_poses, looks_ahead, read_calibration
from prf.shell.errors import InputError
from tests.mapq.perturb.scenes import pose_at
from tests.shell.test_pose_files import written

CAMERA = np.array([[0.0, -1.0, 0.0, 0.1], [0.0, 0.0, -1.0, -0.2], [1.0, 0.0, 0.0, -0.3], [0.0, 0.0, 0.0, 1.0]])
"""Camera from laser: x right, y down, z ahead from x ahead, y left, z up."""


def test_camera_poses_become_those_of_the_laser(tmp_path):
    laser = np.array([np.eye(4), pose_at(2.0, 0.1, 3.0, 0.0), pose_at(4.0, 0.3, 6.0, 0.0)])
    camera = CAMERA @ laser @ np.linalg.inv(CAMERA)
    text = "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: " + " ".join(str(x) for x in CAMERA[:3].ravel()) + "\n"
    calibration = read_calibration(written(tmp_path, text, "calib.txt"))
    np.testing.assert_allclose(laser_poses(camera, calibration), laser, atol=1e-12)
    assert looks_ahead(camera) is True
    assert looks_ahead(laser) is False
    assert looks_ahead(camera[:1]) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("P0: 1 0 0\n", "calib.txt: no row Tr:"),
        ("Tr: 1 0 0\n", "calib.txt:1: expected the 12 numbers"),
        ("P0: 1\nTr: 1 0 0 nan 0 1 0 0 0 0 1 0\n", "calib.txt:2: 'nan' is not a finite number"),
        ("P0: 1\nTr: 1 0 0 0 0 1 0 0 0 0 3 0\n", "calib.txt:2: the matrix of this pose is not a rotation"),
    ],
)
def test_what_is_no_calibration_is_refused(text, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_calibration(written(tmp_path, text, "calib.txt"))


def test_a_drive_up_and_back_has_two_passes_and_a_third():
    there = np.arange(0.0, 100.0, 2.0)
    poses = np.array([pose_at(x, 0.0) for x in (*there, *there[::-1], *there)])
    passes = drive_passes(poses)
    assert passes[0] == 0
    assert (np.diff(passes) >= 0).all()
    # The turn is noticed where 40 m of way lie between: 20 m behind it.
    assert [int(np.flatnonzero(passes == number)[0]) for number in (1, 2)] == pytest.approx([60, 110], abs=6)
    assert passes.max() == 2


# Public scans: neighbouring ones lie on each other where their poses put them, and not without.


def overlap(scans, placed, step=40, within=0.2):
    """Return the share of points of scan 1 that lie on scan 0."""
    points = []
    for number in (0, 1):
        pose = scans.poses[number] if placed else np.eye(4)
        points.append(scans.read(number).world() @ pose[:3, :3].T + pose[:3, 3])
    distance = cKDTree(points[0]).query(points[1][::step], distance_upper_bound=1.0)[0]
    return float((distance < within).mean())


CASES = [
    ("kitti00_map-metrics", {"calibration": "derived/calib_Tr.txt"}, 20, 0.15),
    ("newer_college_01", {"pattern": "planes_*"}, 5, 0.3),
    ("plane_localization_hall", {"quaternion": "wxyz"}, 11, 0.1),
    ("3dtk_dat", {}, 2, 0.2),
]


@pytest.mark.parametrize(("name", "settings", "count", "gain"), CASES, ids=[case[0] for case in CASES])
def test_poses_lay_neighbouring_scans_onto_each_other(name, settings, count, gain, shared_data):
    folder = shared_data / "mapq" / name
    if "calibration" in settings:
        settings = {**settings, "calibration": str(folder / settings["calibration"])}
    columns = 3 if name == "newer_college_01" else 4
    scans = find_scans([str(folder)], FindSettings(**settings), ReadOptions(bin_columns=columns))
    assert len(scans) == count
    assert overlap(scans, True) > overlap(scans, False) + gain


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("kitti00_map-metrics", "poses of a camera"),
        ("newer_college_01", "several sets of scans"),
        ("plane_localization_hall", "scans.quaternion"),
        ("dxmcu_map", "--poses"),
    ],
)
def test_what_these_sets_lack_is_required(name, message, shared_data):
    with pytest.raises(InputError, match=message):
        find_scans([str(shared_data / "mapq" / name)])


def test_e57_of_others(shared_data):
    pytest.importorskip("pye57")
    posed = find_scans([str(shared_data / "mapq" / "pye57_e57" / "translationWithoutRotation.e57")])
    assert posed.poses[0, :3, 3].tolist() == [4.0, 5.0, 6.0]
    pump = find_scans([str(shared_data / "mapq" / "pye57_e57" / "pumpAVisualReferenceImage.e57")])
    assert {"intensity", "red", "green", "blue"} <= set(pump.read(0).fields)
    assert len(find_scans([str(shared_data / "mapq" / "pdal_formats" / "A_B.e57")])) == 2
