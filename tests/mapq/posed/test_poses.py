from __future__ import annotations

import gzip

import numpy as np
import pytest

from mapq.posed import drive_passes, read_poses
from mapq.posed.poses import laser_poses, looks_ahead, quaternion_rotation, read_calibration
from prf.shell.errors import InputError
from tests.mapq.perturb.scenes import pose_at

POSES = np.array([pose_at(1.0, 2.0, 30.0), pose_at(-4.0, 5.0, -100.0)])
HALF = np.radians([15.0, -50.0])
QUATERNIONS = np.column_stack([np.zeros(2), np.zeros(2), np.sin(HALF), np.cos(HALF)])
PLACES = POSES[:, :3, 3]


def rows(values):
    return "".join(" ".join(f"{number:.17g}" for number in row) + "\n" for row in values)


QUATERNION_ROWS = rows(np.column_stack([PLACES, QUATERNIONS]))
LAYOUTS = {
    "kitti": rows(POSES[:, :3].reshape(2, 12)),
    "full": rows(POSES.reshape(2, 16)),
    "blocks": rows(POSES.reshape(8, 4)).replace("\n", "\n\n", 4),
    "quaternion": QUATERNION_ROWS,
    "commas": "# tx,ty,tz,qx,qy,qz,qw\n" + QUATERNION_ROWS.replace(" ", ", "),
    "tum": rows(np.column_stack([[12.5, 13.0], PLACES, QUATERNIONS])),
    "stamped": rows(np.column_stack([POSES.reshape(2, 16)[:, :15], [1.3e9, 1.3e9 + 0.1]])),
    "g2o": "".join(f"VERTEX_SE3:QUAT {k} {line}\n" for k, line in enumerate(QUATERNION_ROWS.splitlines()))
    + "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n",
    "graph": "".join(f"v{k} {line}\n" for k, line in enumerate(QUATERNION_ROWS.splitlines())),
}


def written(tmp_path, text, name="poses.txt"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout(layout, tmp_path):
    table = read_poses(written(tmp_path, LAYOUTS[layout]))
    np.testing.assert_allclose(table.poses, POSES, atol=1e-12)
    assert (table.times is not None) == (layout in ("tum", "stamped"))
    assert table.names == (("v0", "v1") if layout in ("graph", "g2o") else None)
    assert table.is_matrix == (layout == "kitti")


def test_gzipped_and_with_the_scalar_part_first(tmp_path):
    path = tmp_path / "poses.txt.gz"
    path.write_bytes(gzip.compress(rows(np.column_stack([PLACES, QUATERNIONS[:, [3, 0, 1, 2]]])).encode()))
    np.testing.assert_allclose(read_poses(str(path), "wxyz").poses, POSES, atol=1e-12)


def test_an_order_of_quaternions_that_hangs_sensors_upside_down_is_not_guessed(tmp_path):
    path = written(tmp_path, rows(np.column_stack([PLACES, QUATERNIONS[:, [3, 0, 1, 2]]])))
    with pytest.raises(InputError, match=r"poses.txt: read as tx ty tz qx .* perturb.quaternion=wxyz"):
        read_poses(path)
    assert read_poses(path, "xyzw").poses[0, 2, 2] < 0.0


def test_rounded_rotations_become_exact(tmp_path):
    table = read_poses(written(tmp_path, "".join(f"{x:.3f} " for x in POSES[0, :3].ravel()) + "\n"))
    np.testing.assert_allclose(table.poses[0, :3, :3] @ table.poses[0, :3, :3].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "poses.txt: no poses. Read are rows of 12"),
        ("# nothing\n\n", "poses.txt: no poses"),
        ("1 2 3\n", "poses.txt:1: 3 columns are no pose"),
        ("0 0 0 0 0 0 1\n\n0 0 0 0 0 1\n", "poses.txt:3: 6 columns, but 7 before"),
        ("0 0 0 0 0 0 1\n0 0 x 0 0 0 1\n", "poses.txt:2: 'x' is not a finite number"),
        ("0 0 0 0 0 0 1\n0 0 nan 0 0 0 1\n", "poses.txt:2: 'nan' is not a finite number"),
        (f"0 {'0 ' * 6}1\nnan {'0 ' * 6}1\n", "poses.txt:2: 'nan' is not a finite number"),
        ("0 0 0 0 0 0 1\n0 1e200 0 0 0 0 1\n", "poses.txt:2: a number is beyond 1e"),
        ("0 0 0 0 0 0 1\n0 0 0 1 0 0 1\n", r"poses.txt:2: the last four .* no unit quaternion \(length 1.41"),
        ("1 0 0 0 0 2 0 0 0 0 1 0\n", "poses.txt:1: the matrix of this pose is no rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "poses.txt:1: the matrix of this pose mirrors"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 5 5 5 1\n", "poses.txt:1: the last row of this 4x4 matrix"),
    ],
)
def test_what_is_no_pose_is_refused_with_its_line(text, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_poses(written(tmp_path, text))


def test_a_quaternion_turns_as_its_definition_says():
    rng = np.random.default_rng(1)
    values = rng.normal(size=(5, 4))
    values /= np.linalg.norm(values, axis=1, keepdims=True)
    point = rng.normal(size=3)
    for (x, y, z, w), rotation in zip(values, quaternion_rotation(values), strict=True):
        axis = np.array([x, y, z])
        turned = point + 2 * w * np.cross(axis, point) + 2 * np.cross(axis, np.cross(axis, point))
        np.testing.assert_allclose(rotation @ point, turned, atol=1e-12)


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
