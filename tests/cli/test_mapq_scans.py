"""From each kind of input to a picture in two commands; scans with poses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import MergeSettings
from mapq.io import read_cloud, write_cloud
from mapq.posed import find_scans, merge_scans
from tests.cli.mapq_samples import call
from tests.mapq.io.test_other_formats import ptx
from tests.mapq.perturb.scenes import COURT, look, pose_at
from tests.mapq.posed.test_find import write_e57
from tests.shell.test_pose_files import rows

RIGHT = np.array([pose_at(4.0 + 4.0 * scan, 6.0, 12.0 * scan) for scan in range(4)])
POSES = RIGHT.copy()
POSES[2:, 1, 3] += 0.5
"""A drive through a yard of four walls; from the third scan on the poses are half a metre off, along y."""
SCANS = [(look(COURT, p, k, 12.0) - p[:3, 3]) @ p[:3, :3] for k, p in enumerate(RIGHT)]
PLACED = [points @ p[:3, :3].T + p[:3, 3] for points, p in zip(SCANS, POSES, strict=True)]
HALF = np.radians(6.0) * np.arange(4)
QUATERNIONS = np.column_stack([POSES[:, :3, 3], np.zeros((4, 2)), np.sin(HALF), np.cos(HALF)])
TIMES = 1.7e9 + 0.1 * np.arange(4)
FRAMES = [{"file_path": f"a/{k}.ply", "transform_matrix": POSES[k].tolist()} for k in (3, 2, 1, 0)]
POSE_FILES = {
    "kitti": ("poses.txt", rows(POSES[:, :3].reshape(4, 12))),
    "tum": ("trajectory.tum", rows(np.column_stack([TIMES, QUATERNIONS]))),
    "g2o": ("graph.g2o", "".join(f"VERTEX_SE3:QUAT {k} {rows(QUATERNIONS[k : k + 1])}" for k in range(4))),
    "json": ("poses.json", json.dumps({"frames": FRAMES})),
}


def write_pcd(path: Path, points: np.ndarray, viewpoint: np.ndarray = QUATERNIONS[0]) -> None:
    head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT "
    words = " ".join(map(str, viewpoint[[0, 1, 2, 6, 3, 4, 5]]))
    path.write_bytes(f"{head}{words}\nPOINTS {len(points)}\nDATA binary\n".encode() + points.astype("<f4").tobytes())


def write_scans(folder: Path, kind: str) -> None:
    """Write scans, with a file of poses of this kind above them."""
    (folder / "scans").mkdir()
    for scan, points in enumerate(SCANS):
        name = f"{round(1e9 * TIMES[scan])}" if kind == "tum" else f"{scan}"
        write_cloud(str(folder / "scans" / f"{name}.ply"), PointCloud.from_world(points.astype(np.float32)))
    name, text = POSE_FILES[kind]
    (folder / name).write_text(text)


def write_input(folder: Path, kind: str) -> str:
    """Write an input of this kind, and return its name."""
    name, world = f"drive.{kind}", np.concatenate(PLACED)
    if kind in POSE_FILES:
        write_scans(folder, kind)
        return "scans"
    if kind.startswith("viewpoint"):
        (folder / "posed").mkdir()
        for scan, points in enumerate(PLACED if "map" in kind else SCANS):
            write_pcd(folder / "posed" / f"{scan}.pcd", points, QUATERNIONS[scan])
        return "posed"
    if kind in ("ply", "laz"):
        write_cloud(str(folder / name), PointCloud.from_world(world.astype(np.float32)))
    elif kind == "pcd":
        write_pcd(folder / name, world)
    elif kind == "e57":
        write_e57(folder / name, SCANS, POSES)
    else:
        for points, pose in zip(SCANS, POSES, strict=True):
            with (folder / name).open("a") as stream:
                stream.write(ptx([" ".join(f"{x:.4f}" for x in (*point, 0.5)) for point in points], 1, pose.T))
    return name


KINDS = ("ply", "laz", "pcd", "e57", "ptx", *POSE_FILES, "viewpoint", "viewpoint in the map")


KEPT = {"laz": ".laz", "pcd": ".pcd"}
"""Formats of one file that are written too."""


@pytest.mark.parametrize("kind", KINDS)
def test_two_commands_lead_to_a_page(kind: str, tmp_path, capsys, monkeypatch) -> None:
    """A newcomer classifies what there is, and looks at the report; where scans are known the error is found."""
    monkeypatch.chdir(tmp_path)
    name = write_input(tmp_path, kind)
    code, out, err = call(capsys, "classify", name)
    assert (code, len(out.splitlines()) <= 15) == (0, True), err
    result = Path(f"{Path(name).stem}.classified{KEPT.get(kind, '.ply')}")
    assert out.splitlines()[-1] == f"result          {result} and .json"
    assert "% of these in judged ones: upright" in out
    assert call(capsys, "report", str(result))[0] == 0
    assert result.with_suffix(".html").stat().st_size > 50_000
    cloud = read_cloud(str(result))
    np.testing.assert_allclose(cloud.world(), np.concatenate(PLACED), atol=2e-3)
    if kind not in ("ply", "laz", "pcd"):
        sensor = cloud.world() + np.column_stack([cloud.fields[f"to_sensor_{axis}"] for axis in "xyz"])
        np.testing.assert_allclose(sensor, POSES[cloud.fields["scan"], :3, 3], atol=2e-3)
        head = json.loads(result.with_suffix(".json").read_text())
        assert head["verdict"]["disagreement_m"] > 0.15
        assert head["counts"]["share_of_area"] > 0.3
    if kind == "tum":
        np.testing.assert_allclose(np.unique(cloud.fields["time"]), TIMES, atol=1e-5)


def test_segment_takes_scans_too(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_scans(tmp_path, "kitti")
    (tmp_path / "scans" / "0.classified.ply").write_text("a result is no scan")
    assert len(find_scans(["scans"])) == 4
    files = [f"scans/{scan}.ply" for scan in range(4)]
    assert call(capsys, "segment", *files, "--poses", "poses.txt", "--every", 2, "-q")[1] == ""
    code, out, _ = call(capsys, "inspect", "scans.patches")
    assert code == 0
    assert "scan  int32  0 to 1" in out


def test_an_e57_of_several_scans_is_checked_scan_by_scan(tmp_path, capsys, monkeypatch) -> None:
    """As a folder with it is; tiles that are asked for, and scans of which no poses are known, are one cloud."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    write_e57(tmp_path / "drive.e57", SCANS, POSES)
    write_e57(tmp_path / "folder" / "drive.e57", SCANS, POSES)
    heads = [json.loads(call(capsys, "classify", name, "--json")[1]) for name in ("drive.e57", "folder")]
    found = [[{**row, "file": Path(row["file"]).name} for row in head["scans"]] for head in heads]
    assert len(found[0]) == 4
    assert found[0] == found[1]
    assert heads[0]["output"] == "drive.classified.ply"
    feet = json.loads(call(capsys, "classify", "drive.e57", "--json", "--unit", "2", "-o", "large.ply")[1])
    assert feet["counts"]["area_m2"] == pytest.approx(4.0 * heads[0]["counts"]["area_m2"], rel=0.3)
    assert len(feet["scans"]) == 4
    assert call(capsys, "segment", "drive.e57", "-q")[0] == 0
    assert "pass_id" in call(capsys, "inspect", "drive.patches")[1]
    write_e57(tmp_path / "pair.e57", SCANS[1:3], POSES[1:3])
    pair = json.loads(call(capsys, "classify", "pair.e57", "--json")[1])
    assert pair["verdict"]["cause"] == "wrong scan"
    assert [row["blamed_m2"] for row in pair["scans"]] == [0.0, 0.0], "of two neither can be told"
    write_e57(tmp_path / "placed.e57", PLACED, [np.eye(4)] * 4)
    for name, *more in (("drive.e57", "--workers", 1, "--force"), ("placed.e57",)):
        code, out, err = call(capsys, "classify", name, "--json", *more)
        assert (code, json.loads(out)["scans"]) == (0, []), err


def test_an_e57_that_cannot_be_opened_is_one_line(tmp_path, capsys, monkeypatch) -> None:
    pytest.importorskip("pye57")
    monkeypatch.chdir(tmp_path)
    Path("map.e57").write_bytes(b"ASTM-E57")
    for name, words in (("none.e57", "no such file"), ("map.e57", "cannot be opened as E57")):
        code, _, err = call(capsys, "classify", name)
        assert (code, err.count("\n"), words in err) == (3, 1, True), err
    monkeypatch.setitem(sys.modules, "pye57", None)
    code, _, err = call(capsys, "classify", "map.e57")
    assert (code, err.count("\n"), "pip install" in err) == (2, 1, True), err


def test_las_beside_poses_is_scans_where_poses_are_named_else_tiles(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "las").mkdir()
    for scan, points in enumerate(SCANS[:2]):
        write_cloud(f"las/{scan}.las", PointCloud.from_world(points))
    (tmp_path / "las" / "poses.txt").write_text(rows(POSES[:2, :3].reshape(2, 12)))
    words = "taken for tiles of one map. If these are scans: --poses las/poses.txt"
    for more, warned in (([], True), (["--poses", "las/poses.txt"], False)):
        code, _, err = call(capsys, "classify", "las", *more)
        assert (code, words in err) == (0, warned), err


def test_beams_without_a_return_are_left_out(tmp_path, caplog) -> None:
    """A sensor wrote its largest range for them; a limit that drops them says nothing."""
    (tmp_path / "scans").mkdir()
    turn = np.linspace(0.0, 1.0, 40)
    arc = 32.767 * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    for scan, points in enumerate(SCANS):
        cloud = PointCloud.from_world(np.concatenate([points, arc]).astype(np.float32))
        write_cloud(str(tmp_path / "scans" / f"{scan}.ply"), cloud)
    (tmp_path / "poses.txt").write_text(POSE_FILES["kitti"][1])
    scans = find_scans([str(tmp_path)])
    merged = merge_scans(scans)
    assert "160 points at 32.77 m, the largest range, are beams without a return and left out" in caplog.text
    assert len(merged) == sum(map(len, SCANS))
    caplog.clear()
    assert len(merge_scans(scans, MergeSettings(max_range=32.0))) == len(merged)
    assert "without a return" not in caplog.text


def test_too_many_points_are_thinned_as_one_voxel_would(tmp_path, capsys, monkeypatch) -> None:
    write_scans(tmp_path, "kitti")
    scans = find_scans([str(tmp_path)])
    few, same = (merge_scans(scans, MergeSettings(**how)) for how in ({"max_points": 3000}, {"voxel": 1.6}))
    assert 500 < len(few) <= 3000
    np.testing.assert_array_equal(few.xyz, same.xyz)
    assert len(merge_scans(scans, MergeSettings(max_points=1))) < 40, "it ends"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda poses: np.tile(POSES[:1], (4, 1, 1)), "all 4 scans have one pose"),
        (lambda poses: poses @ pose_at(0, 0, 0, 0)[[1, 2, 0, 3]], "the sensors lie on their side"),
        (lambda poses: poses + 1e3 * np.eye(4)[3] * (poses - poses[0])[:, :, 3:], "are m apart|m apart and see"),
    ],
)
def test_poses_that_do_not_fit_are_reported(change, words, tmp_path, caplog) -> None:
    write_scans(tmp_path, "kitti")
    (tmp_path / "poses.txt").write_text(rows(change(POSES)[:, :3].reshape(4, 12)))
    merge_scans(find_scans([str(tmp_path)]))
    assert any(word in caplog.text for word in words.split("|")), caplog.text


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_sub_maps_whose_poses_are_in_another_unit_are_reported(scale, tmp_path, caplog) -> None:
    write_scans(tmp_path, "kitti")
    poses = POSES[:, :3].copy()
    poses[:, :, 3] *= scale
    (tmp_path / "poses.txt").write_text(rows(poses.reshape(4, 12)))
    merge_scans(find_scans([str(tmp_path)]), MergeSettings(submaps=True))
    assert ("Are poses in metres, and points (--unit)?" in caplog.text) == (scale > 1.0)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("log.clf", "FLASER 2 1.0 2.0 0 0 0 0 0 0 1.0 host 1.0\n", "a log of a 2D laser or sonar"),
        ("readings.csv", "x,y,theta,range\n0,0,0,1\n", "a table of 2D readings"),
        ("poses.txt", rows(QUATERNIONS), "these are poses, not points"),
        ("kitti.txt", rows(POSES[:, :3].reshape(4, 12)), "these are poses, not points"),
    ],
)
def test_what_was_meant_is_named(name, text, words, tmp_path, capsys) -> None:
    (tmp_path / name).write_text(text)
    code, out, err = call(capsys, "classify", tmp_path / name)
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert words in err
