"""Public scans: neighbouring ones lie on each other where their poses put them, and not without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mapq.io import ReadOptions
from mapq.posed import FindSettings, find_scans
from prf.shell.errors import InputError


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
    ("newer_college_01", {"pattern": "planes_*", "options": ReadOptions(bin_columns=3)}, 5, 0.3),
    ("plane_localization_hall", {"quaternion": "wxyz"}, 11, 0.1),
    ("3dtk_dat", {}, 2, 0.2),
]


@pytest.mark.parametrize(("name", "settings", "count", "gain"), CASES, ids=[case[0] for case in CASES])
def test_poses_lay_neighbouring_scans_onto_each_other(name, settings, count, gain, shared_data):
    folder = shared_data / "mapq" / name
    if "calibration" in settings:
        settings = {**settings, "calibration": str(folder / settings["calibration"])}
    scans = find_scans([str(folder)], FindSettings(**settings))
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
