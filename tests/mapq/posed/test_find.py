from __future__ import annotations

import gzip
import sys
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import FindSettings, ReadOptions
from mapq.io import write_ply
from mapq.posed import find_scans, replace_poses
from mapq.posed.files import family, natural_key, number_of
from prf.shell.errors import InputError, UsageError
from tests.mapq.io.test_other_formats import TURNED, ptx
from tests.mapq.perturb.scenes import pose_at
from tests.mapq.posed.test_poses import CAMERA
from tests.shell.test_pose_files import rows


def numbered(count):
    return [np.arange(12.0).reshape(4, 3) + 100.0 * number for number in range(count)]


def poses_text(count):
    return rows([pose_at(2.0 * number, 0.0)[:3].ravel() for number in range(count)])


def make_folder(tmp_path, names, poses=None, where="scans"):
    """Write a PLY of four points for each name, and poses.txt."""
    folder = tmp_path / where
    folder.mkdir(exist_ok=True)
    for points, name in zip(numbered(len(names)), names, strict=True):
        write_ply(str(folder / name), PointCloud.from_world(points))
    if poses is not None:
        (tmp_path / "poses.txt").write_text(poses)
    return folder


def test_a_folder_with_scans_in_a_folder_and_poses_beside(tmp_path):
    make_folder(tmp_path, [f"{number}.ply" for number in range(12)], poses_text(12))
    (tmp_path / "times.txt").write_text("\n".join(str(0.1 * number) for number in range(12)))
    scans = find_scans([str(tmp_path)])
    assert len(scans) == 12
    assert [number_of(name) for name in scans.names] == list(range(12)), "2 before 10"
    # 10.ply was written third of twelve in the order of a shell, eleventh here.
    assert scans.read(10).xyz[0].tolist() == [1000.0, 1001.0, 1002.0]
    assert scans.poses[10, 0, 3] == 20.0
    np.testing.assert_allclose(scans.times, 0.1 * np.arange(12))
    third = scans.every(5)
    assert [number_of(name) for name in third.names] == [0, 5, 10]
    assert third.read(2).xyz[0, 0] == 1000.0
    assert third.times.tolist() == pytest.approx([0.0, 0.5, 1.0])


def test_files_are_sorted_by_their_numbers(tmp_path):
    folder = make_folder(tmp_path, ["0.ply", "2.ply", "10.ply"], poses_text(3))
    files = [str(folder / name) for name in ("10.ply", "0.ply", "2.ply")]
    assert [number_of(name) for name in find_scans(files).names] == [0, 2, 10]
    given = find_scans(files, FindSettings(poses=str(tmp_path / "poses.txt")))
    assert given.poses[2, 0, 3] == 4.0


def test_poses_of_a_whole_sequence_are_matched_by_numbers(tmp_path):
    make_folder(tmp_path, ["000003.ply", "000007.ply"], poses_text(9))
    assert find_scans([str(tmp_path)]).poses[:, 0, 3].tolist() == [6.0, 14.0]


def test_the_matrix_of_ptx_is_not_applied_beside_a_pose(tmp_path):
    for number in range(2):
        (tmp_path / f"{number}.ptx").write_text(ptx(["1 2 3 0.5", "4 5 6 0.5"], matrix=TURNED))
    (tmp_path / "poses.txt").write_text("10 0 0 0 0 0 1\n20 0 0 0 0 0 1\n")
    scans = find_scans([str(tmp_path)])
    assert scans.read(1).world().tolist() == [[1, 2, 3], [4, 5, 6]]
    (tmp_path / "1.ptx").write_text(ptx(["1 2 3 0.5"]) + ptx(["1 2 3 0.5"]))
    with pytest.raises(InputError, match="2 scans in one file, but one pose"):
        scans.read(1)


def test_scans_whose_names_are_times_are_matched_by_these(tmp_path, caplog):
    """Python writes 100.1 and 100.05: by whole numbers 1 would come before 5, and 5 be the sixth row."""
    times = np.round(100.0 + 0.05 * np.arange(40), 2)
    rows = [f"{time + 0.0004} {place} 0 0 0 0 0 1" for place, time in enumerate(times)]
    (tmp_path / "trajectory.txt").write_text("\n".join(rows))
    for place in (2, 1, 3, 6):
        (tmp_path / f"{times[place]}.xyz").write_text("1 2 3\n")
    scans = find_scans([str(tmp_path)])
    assert [Path(name).name for name in scans.names] == ["100.05.xyz", "100.1.xyz", "100.15.xyz", "100.3.xyz"]
    assert scans.poses[:, 0, 3].tolist() == [1, 2, 3, 6]
    (tmp_path / "100.31.xyz").write_text("1 2 3\n")
    assert find_scans([str(tmp_path)]).poses[4, 0, 3] == pytest.approx(6.192), "interpolated"
    (tmp_path / "107.31.xyz").write_text("1 2 3\n")
    assert len(find_scans([str(tmp_path)])) == 5
    assert "no pose for 1 of 6 scans, which are left out: 107.31.xyz" in caplog.text
    (tmp_path / "107.31.xyz").unlink()
    (tmp_path / "trajectory.txt").write_text("\n".join(f"{n} {n} 0 0 0 0 0 1" for n in range(5)))
    assert find_scans([str(tmp_path)]).poses[:, 0, 3].tolist() == [0, 1, 2, 3, 4], "another clock: by order"


def test_names_in_graph_txt_are_matched_by_their_numbers(tmp_path):
    folder = make_folder(tmp_path, ["4.ply", "9.ply"])
    text = "".join(f"v{number} {number} 0 0 0 0 0 1\n" for number in range(0, 20, 1))
    (folder / "graph.txt").write_text(text)
    assert find_scans([str(tmp_path)]).poses[:, 0, 3].tolist() == [4.0, 9.0]
    (folder / "graph.txt").write_text("v9 9 0 0 0 0 0 1\nv4 4 0 0 0 0 0 1\n")
    assert find_scans([str(tmp_path)]).poses[:, 0, 3].tolist() == [4.0, 9.0], "not by order"
    (folder / "graph.txt").write_text("v1 4 0 0 0 0 0 1\nv0 9 0 0 0 0 0 1\n")
    assert find_scans([str(tmp_path)]).poses[:, 0, 3].tolist() == [4.0, 9.0], "other numbers: by order"


def test_a_first_column_that_may_number_the_scans_is_refused(tmp_path):
    text = "".join(f"{number} {2.0 * number} 0 0 0 0 0 1\n" for number in range(1, 7))
    make_folder(tmp_path, ["000001.ply", "000002.ply", "000003.ply"], text)
    with pytest.raises(InputError, match="is the first column times, or numbers of scans"):
        find_scans([str(tmp_path)])


@pytest.mark.parametrize("unit", [None, 0.01])
def test_scans_are_read_in_the_unit_that_is_given(unit, tmp_path):
    make_folder(tmp_path, ["0.ply", "1.ply"], poses_text(2))
    scan = find_scans([str(tmp_path)], options=ReadOptions(unit=unit)).read(1)
    assert scan.metric_of(scan.xyz)[0].tolist() == pytest.approx((np.arange(100.0, 103.0) * (unit or 1.0)).tolist())


@pytest.mark.parametrize(
    ("names", "poses", "message"),
    [
        ([], "", "no scans in it"),
        (["map.ply"], poses_text(1), "no scans in it"),
        (["a0.ply", "a1.ply", "b0.ply"], poses_text(2), r"several sets of scans: scans/a\*.ply \(2\), scans/b\*.ply"),
        (["0.ply", "1.ply"], None, "no file of poses beside the scans. Name it with --poses"),
        (["4.ply", "9.ply"], poses_text(6), "6 poses for 2 scans.* --scans"),
        (["a1.ply", "a2.ply", "a3.ply"], poses_text(2), "2 poses for 3 scans"),
    ],
)
def test_what_cannot_be_inferred_is_required(names, poses, message, tmp_path):
    make_folder(tmp_path, names, poses)
    with pytest.raises(InputError, match=message):
        find_scans([str(tmp_path)])


def test_two_files_of_poses_are_not_guessed_between(tmp_path):
    make_folder(tmp_path, ["0.ply"], poses_text(1))
    (tmp_path / "poses_icp.txt").write_text(poses_text(1))
    with pytest.raises(InputError, match=r"which file has the poses: .*poses.txt, .*poses_icp.txt\? Name it"):
        find_scans([str(tmp_path)])


def test_a_pattern_chooses(tmp_path):
    make_folder(tmp_path, ["a0.ply", "a1.ply", "b0.ply"], poses_text(2))
    assert len(find_scans([str(tmp_path)], FindSettings(pattern="scans/a*"))) == 2
    with pytest.raises(InputError, match=r"no file in it is called c\*"):
        find_scans([str(tmp_path)], FindSettings(pattern="c*"))
    with pytest.raises(UsageError, match="--scans chooses among the files of a folder"):
        find_scans([str(tmp_path / "scans" / "a0.ply"), str(tmp_path / "scans" / "a1.ply")], FindSettings(pattern="*"))


def test_other_poses_for_the_same_scans(tmp_path):
    make_folder(tmp_path, ["0.ply", "1.ply"], poses_text(2))
    scans = find_scans([str(tmp_path)])
    (tmp_path / "other").mkdir()
    other = tmp_path / "other" / "slam.txt"
    other.write_text("0 0 0 0 0 0 1\n0 9 0 0 0 0 1\n")
    assert replace_poses(scans, str(other), FindSettings()).poses[1, 1, 3] == 9.0


def kitti_folder(tmp_path, calibrated):
    laser = np.array([np.eye(4), pose_at(2.0, 0.0, 2.0, 0.0), pose_at(4.0, 0.1, 4.0, 0.0)])
    camera = CAMERA @ laser @ np.linalg.inv(CAMERA)
    (tmp_path / "velodyne").mkdir()
    for number, points in enumerate(numbered(3)):
        values = np.column_stack([points, np.full(4, 0.5)]).astype("<f4")
        (tmp_path / "velodyne" / f"{number:06d}.bin.gz").write_bytes(gzip.compress(values.tobytes()))
    (tmp_path / "poses.txt").write_text(rows(camera[:, :3].reshape(3, 12)))
    if calibrated:
        (tmp_path / "calib.txt").write_text("Tr: " + " ".join(map(str, CAMERA[:3].ravel())))
    return laser


def test_kitti_with_its_calibration_beside(tmp_path):
    laser = kitti_folder(tmp_path, calibrated=True)
    scans = find_scans([str(tmp_path)])
    np.testing.assert_allclose(scans.poses, laser, atol=1e-12)
    assert scans.read(1).fields["intensity"].tolist() == [0.5] * 4
    (tmp_path / "poses").mkdir()  # the layout of the benchmark itself: poses/00.txt
    (tmp_path / "poses.txt").rename(tmp_path / "poses" / "00.txt")
    apart = find_scans([str(tmp_path)], FindSettings(poses=str(tmp_path / "poses" / "00.txt")))
    np.testing.assert_allclose(apart.poses, laser, atol=1e-12)


def test_kitti_without_calibration_is_refused_unless_there_is_none(tmp_path):
    laser = kitti_folder(tmp_path, calibrated=False)
    with pytest.raises(InputError, match="--calibration"):
        find_scans([str(tmp_path)])
    as_they_are = find_scans([str(tmp_path)], FindSettings(calibration="none")).poses
    np.testing.assert_allclose(as_they_are, CAMERA @ laser @ np.linalg.inv(CAMERA), atol=1e-12)


def test_poses_of_a_camera_for_scans_of_another_format_are_reported(tmp_path, caplog):
    laser = kitti_folder(tmp_path, calibrated=False)
    files = [str(tmp_path / f"{number}.xyz") for number in range(3)]
    for name in files:
        Path(name).write_text("1 2 3\n")
    settings = FindSettings(poses=str(tmp_path / "poses.txt"))
    find_scans(files, settings)
    assert "moves along its z axis" in caplog.text
    caplog.clear()
    find_scans(files, settings.replace(calibration="none"))
    assert caplog.text == ""
    (tmp_path / "calib.txt").write_text("Tr: " + " ".join(map(str, CAMERA[:3].ravel())))
    taken = find_scans(files, settings.replace(calibration=str(tmp_path / "calib.txt")))
    np.testing.assert_allclose(taken.poses, laser, atol=1e-12)


def test_poses_of_the_laser_are_known_from_those_of_the_camera(tmp_path, caplog):
    laser = kitti_folder(tmp_path, calibrated=True)
    slam = tmp_path / "slam.txt"
    slam.write_text(rows(laser[:, :3].reshape(3, 12)))
    calibration = FindSettings(calibration=str(tmp_path / "calib.txt"))
    scans = find_scans([str(tmp_path)], calibration)
    np.testing.assert_allclose(scans.poses, laser, atol=1e-12)
    np.testing.assert_allclose(replace_poses(scans, str(slam), calibration).poses, laser, atol=1e-12)
    again = replace_poses(scans, str(tmp_path / "poses.txt"), calibration)
    np.testing.assert_allclose(again.poses, laser, atol=1e-12)
    assert "Is" not in caplog.text
    find_scans([str(tmp_path)], calibration.replace(poses=str(slam)))
    assert "slam.txt: does not move along its z axis as a camera does. Is" in caplog.text
    # Beside calib.txt too, without a word of it.
    np.testing.assert_allclose(find_scans([str(tmp_path)], FindSettings(poses=str(slam))).poses, laser, atol=1e-12)


def test_3dtk_in_centimetres_and_left_handed(tmp_path):
    (tmp_path / "scan000.3d").write_text("2\n100 200 300 7\n-100 0 50 8\n")
    (tmp_path / "scan000.pose").write_text("0 0 0\n0 0 0\n")
    (tmp_path / "scan001.3d").write_text("100 200 300 7\n-100 0 50 8\n")
    (tmp_path / "scan001.pose").write_text("10 20 30\n0 90 0\n")
    scans = find_scans([str(tmp_path)])
    # x right, y up, z ahead: one metre to the right, two up, three ahead.
    np.testing.assert_allclose(scans.read(0).xyz, [[3.0, -1.0, 2.0], [0.5, 1.0, 0.0]])
    np.testing.assert_array_equal(scans.read(1).xyz, scans.read(0).xyz)
    assert scans.read(0).fields["column_4"].tolist() == [7.0, 8.0]
    np.testing.assert_allclose(scans.poses[0], np.eye(4))
    np.testing.assert_allclose(scans.poses[1, :3, 3], [0.3, -0.1, 0.2])
    # A left-handed turn about "up" by 90 degrees takes ahead to the right.
    np.testing.assert_allclose(scans.poses[1, :3, :3] @ [1.0, 0, 0], [0.0, -1.0, 0.0], atol=1e-12)
    assert np.linalg.det(scans.poses[1, :3, :3]) == pytest.approx(1.0)


def test_a_damaged_pose_of_3dtk_is_refused(tmp_path):
    (tmp_path / "scan000.3d").write_text("1 2 3\n")
    for text in ("1 2 3 4 5", "1 2 3 4 5 six"):
        (tmp_path / "scan000.pose").write_text(text)
        with pytest.raises(InputError, match="expected six numbers"):
            find_scans([str(tmp_path)])


def write_e57(path, points, poses):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path), mode="w")
    for seen, pose in zip(points, poses, strict=True):
        data = {f"cartesian{axis}": seen[:, k] for k, axis in enumerate("XYZ")}
        data["intensity"] = np.arange(len(seen), dtype=np.float64)
        half = np.arctan2(pose[1, 0], pose[0, 0]) / 2.0
        file.write_scan_raw(data, rotation=np.array([np.cos(half), 0, 0, np.sin(half)]), translation=pose[:3, 3])
    file.close()


def test_e57_with_several_scans_and_their_poses(tmp_path):
    points, poses = numbered(2), [pose_at(3.0, 4.0, 40.0), pose_at(-1.0, 2.0, -70.0)]
    write_e57(tmp_path / "two.e57", points, poses)
    for inputs in ([str(tmp_path / "two.e57")], [str(tmp_path)]):
        scans = find_scans(inputs)
        assert len(scans) == 2
        assert scans.names[1].endswith("two.e57 scan 1")
        np.testing.assert_allclose(scans.poses, poses, atol=1e-9)
        np.testing.assert_allclose(scans.read(1).world(), points[1], atol=1e-4)
        assert scans.read(1).fields["intensity"].tolist() == [0.0, 1.0, 2.0, 3.0]
    feet = find_scans([str(tmp_path / "two.e57")], options=ReadOptions(unit=0.3048))
    np.testing.assert_allclose(feet.poses[:, :3, 3], 0.3048 * np.array(poses)[:, :3, 3], atol=1e-9)
    scan = feet.read(1)
    np.testing.assert_allclose(scan.metric_of(scan.xyz), 0.3048 * points[1], atol=1e-4)
    (tmp_path / "slam.txt").write_text("0 0 0 0 0 0 1\n5 0 0 0 0 0 1\n")
    assert find_scans([str(tmp_path / "two.e57")], FindSettings(poses=str(tmp_path / "slam.txt"))).poses[1, 0, 3] == 5.0
    with pytest.raises(InputError, match="Leave out --calibration"):
        find_scans([str(tmp_path / "two.e57")], FindSettings(calibration="calib.txt"))


def test_e57_without_pye57_names_the_extra(tmp_path, monkeypatch):
    (tmp_path / "map.e57").write_bytes(b"ASTM-E57")
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(UsageError, match=r"map.e57: E57 needs pye57, .* pip install"):
        find_scans([str(tmp_path / "map.e57")])


def test_damaged_e57_and_e57_beside_others_are_refused(tmp_path):
    pytest.importorskip("pye57")
    (tmp_path / "map.e57").write_bytes(b"ASTM-E57 and no more")
    with pytest.raises(InputError, match=r"map.e57: cannot be opened as E57"):
        find_scans([str(tmp_path / "map.e57")])
    make_folder(tmp_path, ["0.ply"], where=".")
    with pytest.raises(InputError, match=r"0.ply: not E57, beside files that are"):
        find_scans([str(tmp_path / "map.e57"), str(tmp_path / "0.ply")])


def test_names():
    assert family(Path("pcs/000012.bin.gz")) == "pcs/*.bin"
    assert family(Path("planes_000010.bin")) == "planes_*.bin"
    assert family(Path("map.pcd")) == "map.pcd"
    assert sorted(["s10", "s9", "s"], key=natural_key) == ["s", "s9", "s10"]
    assert number_of("/a1/scan007.3d.gz") == 7
    assert number_of("map.ply") is None
    assert family(Path("a/1305031102.1753.pcd.gz")) == "a/*.pcd"
