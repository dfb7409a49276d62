from __future__ import annotations

import numpy as np
import pytest

from mapq.posed import drive_passes
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
        ("Tr: 1 0 0\n", "calib.txt:1: not the 12 numbers"),
        ("P0: 1\nTr: 1 0 0 nan 0 1 0 0 0 0 1 0\n", "calib.txt:2: 'nan' is not a finite number"),
        ("P0: 1\nTr: 1 0 0 0 0 1 0 0 0 0 3 0\n", "calib.txt:2: the matrix of this pose is no rotation"),
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
