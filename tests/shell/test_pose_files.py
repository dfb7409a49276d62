from __future__ import annotations

import errno
import gzip
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prf.shell.errors import InputError
from prf.shell.poses.bag import bag_in, bag_suffix, open_bag
from prf.shell.poses.files import read_pose_file
from prf.shell.poses.tf import FrameTree
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
    "stamped blocks": rows(np.vstack([POSES[0, :3], [0, 0, 0, 1.3e18], POSES[1, :3], [0, 0, 0, 1.3e18 + 1e8]])),
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
    table = read_pose_file(written(tmp_path, LAYOUTS[layout]))
    np.testing.assert_allclose(table.poses, POSES, atol=1e-12)
    assert (table.times is not None) == (layout in ("tum", "stamped", "stamped blocks"))
    assert table.names == (("v0", "v1") if layout in ("graph", "g2o") else None)
    assert (table.layout == "KITTI") == (layout == "kitti")


TABLES = {
    "by hand": "t,x,y,theta\n{0},{x0},{y0},{a0}\n{1},{x1},{y1},{a1}\n",
    "no header": "{0} {x0} {y0} {a0}\n{1} {x1} {y1} {a1}\n",
    "degrees": "timestamp [ns];pos_x;pos_y;yaw_deg\n{0}000000000;{x0};{y0};30\n{1}000000000;{x1};{y1};-100\n",
    "rostopic": "%time,field.header.stamp,field.header.frame_id,field.pose.pose.position.x,field.pose.pose.position.y,"
    "field.pose.pose.orientation.x,field.pose.pose.orientation.y,field.pose.pose.orientation.z,"
    "field.pose.pose.orientation.w\n5,{0}000000000,map,{x0},{y0},0,0,{s0},{c0}\n6,{1}000000000,,{x1},{y1},0,0,{s1},{c1}\n",
    "euroc": "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    "{0}000000000,{x0},{y0},0,{c0},0,0,{s0}\n{1}000000000,{x1},{y1},0,{c1},0,0,{s1}\n",
    "g2o": "VERTEX_SE2 4 {x0} {y0} {a0}\nFIX 4\nVERTEX_SE2 9 {x1} {y1} {a1}\nEDGE_SE2 4 9 1 0 0 1 0 0 1 0 1\n",
}


@pytest.mark.parametrize("layout", TABLES)
def test_poses_in_the_plane_and_tables_by_their_header(layout, tmp_path):
    values = np.column_stack([PLACES[:, :2].round(6), 2.0 * HALF, np.sin(HALF), np.cos(HALF)]).tolist()
    numbers = {f"{name}{k}": repr(values[k][column]) for k in (0, 1) for column, name in enumerate("xyasc")}
    table = read_pose_file(written(tmp_path, TABLES[layout].format(1700000000, 1700000001, **numbers)))
    flat = POSES.copy()
    flat[:, 2, 3] = 0.0
    np.testing.assert_allclose(table.poses, flat, atol=1e-6)
    if layout == "g2o":
        assert table.names == ("v4", "v9")
    else:
        assert table.times.tolist() == [1.7e9, 1.7e9 + 1.0]


def test_gzipped_and_with_the_scalar_part_first(tmp_path):
    path = tmp_path / "poses.txt.gz"
    path.write_bytes(gzip.compress(rows(np.column_stack([PLACES, QUATERNIONS[:, [3, 0, 1, 2]]])).encode()))
    np.testing.assert_allclose(read_pose_file(str(path), "wxyz").poses, POSES, atol=1e-12)


def test_an_order_of_quaternions_that_hangs_sensors_upside_down_is_not_guessed(tmp_path):
    path = written(tmp_path, rows(np.column_stack([PLACES, QUATERNIONS[:, [3, 0, 1, 2]]])))
    with pytest.raises(InputError, match=r"poses.txt: read as tx ty tz qx .* scans.quaternion=wxyz"):
        read_pose_file(path, key="scans.quaternion")
    assert read_pose_file(path, "xyzw").poses[0, 2, 2] < 0.0


def test_rounded_rotations_become_exact(tmp_path):
    table = read_pose_file(written(tmp_path, "".join(f"{x:.3f} " for x in POSES[0, :3].ravel()) + "\n"))
    np.testing.assert_allclose(table.poses[0, :3, :3] @ table.poses[0, :3, :3].T, np.eye(3), atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "poses.txt: no poses. Rows may be 12"),
        ("1 2 3 4 5\n", "poses.txt:1: 5 columns, expected a pose"),
        (
            "# log\nPARAM laser 1 host 0\nFLASER 1 2 0 0 0 0 0 0 0 host 0\n",
            "poses.txt:2: 'PARAM' is not a finite number",
        ),
        ("0 0 0 0 0 0 1\n\n0 0 0 0 0 1\n", "poses.txt:3: 6 columns, but 7 before"),
        ("0 0 0 0 0 0 1\n0 0 x 0 0 0 1\n", "poses.txt:2: 'x' is not a finite number"),
        ("0 0 0 0 0 0 1\n0 0 nan 0 0 0 1\n", "poses.txt:2: 'nan' is not a finite number"),
        ("0 0 0 0 0 0 1\n0 0 0 1 0 0 1\n", r"poses.txt:2: the last four .* must be a unit quaternion \(length 1.41"),
        ("1 0 0 0 0 2 0 0 0 0 1 0\n", "poses.txt:1: the matrix of this pose is not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "poses.txt:1: the matrix of this pose mirrors"),
        ("t,x,y\n0,1,2\n", "poses.txt:1: the header does not name the columns of poses"),
        ("t,x,y,yaw\n0,1,2,3\n0,1,2,90\n", r"poses.txt:3: an angle is 90 rad. If .*yaw_deg"),
        ("t,x,y,theta,roll\n0,1,2,3,0\n0,1,2,3,90\n", r"poses.txt:3: an angle is 90 rad"),
        ("t,x,y,theta\n0,1,2,3\n0,1,2\n", "poses.txt:3: 3 columns below a header of 4"),
        ("\x16\0\0\0\0\0\0\0serialization::archive", r"state of slam_toolbox .* Record scans and /tf"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 5 5 5 1\n", "poses.txt:1: the last row of this 4x4 matrix"),
    ],
)
def test_what_is_no_pose_is_refused_with_its_line(text, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_pose_file(written(tmp_path, text))


# Headings without a unit, and arrays of numpy.


def driven(n: int = 60, turns: float = 3.0, ahead: float = 1.0) -> np.ndarray:
    """Poses of a robot that drives along a spiral, ahead or backwards, its heading counted over turns."""
    heading = np.linspace(-1.0, 2.0 * np.pi * turns, n)
    steps = ahead * 0.3 * np.column_stack([np.cos(heading), np.sin(heading)])
    return np.column_stack([np.cumsum(steps, axis=0), heading])


@pytest.mark.parametrize("ahead", [1.0, -1.0])
@pytest.mark.parametrize("is_wrapped", [False, True])
def test_headings_are_in_the_unit_that_the_way_follows(ahead, is_wrapped, tmp_path):
    way = driven(ahead=ahead)
    shown = np.angle(np.exp(1j * way[:, 2])) if is_wrapped else way[:, 2]
    radians, degrees = (np.column_stack([way[:, :2], heading]) for heading in (shown, np.degrees(shown)))
    plain, turned = (read_pose_file(written(tmp_path, rows(values))) for values in (radians, degrees))
    np.testing.assert_allclose(turned.poses, plain.poses, atol=1e-9)
    np.testing.assert_allclose(plain.poses[:, :2, 0], np.column_stack([np.cos(shown), np.sin(shown)]), atol=1e-9)
    assert (plain.layout, plain.times) == ("x y theta", None)
    assert turned.layout == "x y theta, headings in degrees, which the way follows"


def test_rows_that_hang_together_by_chance_alone_are_steps(tmp_path):
    heading = np.cumsum(np.tile([0.5, 0.5, 0.0, 0.0, 0.0, -0.4], 10))
    ahead = np.tile([0.0, 0.01, 1.0, 0.9, 0.3, 0.0], 10)
    moved = np.column_stack([ahead * np.cos(heading), ahead * np.sin(heading)])
    way = np.column_stack([np.cumsum(moved, axis=0), heading])
    steps = np.column_stack([ahead, np.zeros(60), np.diff(heading, prepend=0.0)])
    # A step is in the frame of the pose before it: here the robot turns first, then drives.
    turned = np.diff(heading, prepend=0.0)
    steps[:, :2] = np.column_stack([ahead * np.cos(turned), ahead * np.sin(turned)])
    found, plain = (read_pose_file(written(tmp_path, rows(values))) for values in (steps, way))
    np.testing.assert_allclose(found.poses[:, :2, 3], way[:, :2] - way[0, :2] + steps[0, :2], atol=1e-6)
    assert (found.layout, plain.layout) == ("x y theta, rows taken as steps", "x y theta")


def test_headings_that_the_way_says_nothing_of_are_refused_beyond_two_turns(tmp_path):
    still = driven()
    still[:, :2] = 0.0
    with pytest.raises(InputError, match=r"poses.txt:\d+: an angle is .*yaw_deg"):
        read_pose_file(written(tmp_path, rows(still)))
    assert read_pose_file(written(tmp_path, rows(still[:20]))).layout == "x y theta"


@pytest.mark.parametrize("is_across", [False, True])
def test_arrays_of_numpy(is_across, tmp_path):
    way = driven(20, 0.5)
    np.save(tmp_path / "way.npy", way.T if is_across else way)
    table = read_pose_file(str(tmp_path / "way.npy"))
    np.testing.assert_allclose(table.poses[:, :2, 3], way[:, :2])
    np.save(tmp_path / "way.npy", np.where(way == way[3], np.nan, way))
    with pytest.raises(InputError, match=r"way\.npy: row 3 has a number that is not finite"):
        read_pose_file(str(tmp_path / "way.npy"))
    np.save(tmp_path / "way.npy", way[0])
    with pytest.raises(InputError, match=r"way\.npy: not an array of numbers, a row a scan"):
        read_pose_file(str(tmp_path / "way.npy"))


def test_a_mount_that_never_changes_holds_at_all_times() -> None:
    tree = FrameTree()
    turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    for time in (10.0, 11.0):
        tree.add("base", "laser", time, (SimpleNamespace(x=0.2, y=0.0, z=0.0), turn), is_static=False)
        tree.add("odom", "base", time, (SimpleNamespace(x=time, y=0.0, z=0.0), turn), is_static=False)
    times = np.array([0.0, 10.5, 99.0])
    mount, base = tree.poses("base", "laser", times), tree.poses("odom", "base", times)
    assert mount is not None
    assert base is not None
    assert mount.known.all()
    np.testing.assert_array_equal(mount.shift[:, 0], 0.2)
    assert base.known.tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("head", "suffix"),
    [
        (b"#ROSBAG V2.0\n", ".bag"),
        (b"\x89MCAP0\r\n", ".mcap"),
        (b"SQLite format 3\0", ".db3"),
        (b"#ROSBAG V1.2\n", ""),
        (b"", ""),
    ],
)
def test_bags_are_known_by_their_content(head: bytes, suffix: str) -> None:
    assert bag_suffix(head) == suffix


def test_the_bag_in_a_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"without metadata.yaml and with no bag file. Give a log."):
        bag_in(tmp_path, "Give a log.")
    (tmp_path / "first.log").touch()
    with pytest.raises(InputError, match=r"Give one of its files, such as .*first\.log\."):
        bag_in(tmp_path, "Give a log.")
    (tmp_path / "a.mcap").touch()
    assert bag_in(tmp_path, "") == tmp_path / "a.mcap"
    (tmp_path / "b.db3").touch()
    with pytest.raises(InputError, match="with 2 bag files"):
        bag_in(tmp_path, "")
    (tmp_path / "metadata.yaml").touch()
    assert bag_in(tmp_path, "") == tmp_path


def test_a_disk_that_fails_is_not_taken_for_a_damaged_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("rosbags.highlevel.AnyReader.__init__", fail)
    file = tmp_path / "a.bag"
    file.touch()
    with pytest.raises(InputError, match=r"^a log: cannot be read \(input/output error\)\.$"), open_bag(file, "a log"):
        pass
