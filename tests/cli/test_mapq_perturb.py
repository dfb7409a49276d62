"""The verb `mapq perturb`: its map, its report, its parts, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import read_cloud, write_ply
from tests.cli.calls import mapq
from tests.mapq.factories import wall
from tests.mapq.perturb.scenes import look, pose_at
from tests.shell.test_pose_files import rows

POSES = np.array([pose_at(4.0 + 3.0 * scan, -5.0, 10.0 * scan) for scan in range(4)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four scans of a long wall with their poses, and poses that are wrong by 0.5 m from the third on."""
    scans = tmp_path / "scans"
    scans.mkdir()
    for scan, pose in enumerate(POSES):
        seen = look([wall((0.0, 0.0), (18.0, 0.0))], pose, scan, 40.0)
        local = (seen - pose[:3, 3]) @ pose[:3, :3]
        write_ply(str(scans / f"{scan}.ply"), PointCloud.from_world(local.astype(np.float32)))
    (scans / "poses.txt").write_text(rows(POSES[:, :3].reshape(4, 12)))
    wrong = POSES.copy()
    wrong[2:, 1, 3] += 0.5
    (tmp_path / "odometry.txt").write_text(rows(wrong[:, :3].reshape(4, 12)))
    return scans


def test_the_suffix_las_writes_las(folder: Path) -> None:
    ply, laz = folder.parent / "map.ply", folder.parent / "other.laz"
    for out in (ply, laz):
        assert mapq("perturb", str(folder), "--offset", "0.6", "--seed", "1", "-o", str(out), "-q") == 0
    assert laz.read_bytes().startswith(b"LASF")
    fields = read_cloud(str(ply)).fields
    np.testing.assert_array_equal(read_cloud(str(laz)).fields["suspicious"], fields["suspicious"])


def test_the_right_poses_show_what_is_displaced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, odometry = folder.parent / "map.ply", str(folder.parent / "odometry.txt")
    args = (str(folder), "--poses", odometry, "--reference", str(folder / "poses.txt"), "-o", str(out))
    assert mapq("perturb", *args) == 0
    cloud = read_cloud(str(out))
    assert (cloud.fields["suspicious"] == 1).mean() > 0.99
    np.testing.assert_allclose(np.nanmedian(cloud.fields["disagreement"]), 0.5, atol=0.01)
    assert cloud.fields["scan"].dtype == np.int32
    table = capsys.readouterr().out
    assert "labels from     reference poses, within 0.4" in table
    assert "scans           4, " in table
    assert "seed" not in table
    report = json.loads(out.with_suffix(".json").read_text())
    assert report["schema"] == "mapq.perturb/1"
    assert report["n_points"] == len(cloud)
    assert (report["seed"], len(report["scans"])) == (None, 4)
    np.testing.assert_allclose(report["scans"][3]["reference"], POSES[3, :3].ravel())


def test_errors_of_a_seed_give_the_same_bytes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [folder.parent / f"{name}.ply" for name in "abc"]
    for name, seed in zip(names, "112", strict=True):
        assert mapq("perturb", str(folder), "--offset", "0.6", "--yaw", "1", "--seed", seed, "-o", str(name)) == 0
    contents = [name.read_bytes() for name in names]
    assert contents[0] == contents[1] != contents[2]
    assert "seed            2" in capsys.readouterr().out


def test_json_and_a_seed_that_was_drawn(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "map.ply"
    args = (str(folder), "--drift", "0.8", "2", "--missed-loop", "0.5", "0", "-o", str(out), "--json")
    assert mapq("perturb", *args) == 0
    first = json.loads(capsys.readouterr().out)
    assert first == json.loads(out.with_suffix(".json").read_text())
    assert first["errors"] == {"offset": 0.0, "yaw": 0.0, "drift": [0.8, 2.0], "missed_loop": [0.5, 0.0]}
    assert (
        sum(first[f"n_{kind}"] for kind in ("suspicious", "plausible", "ambiguous", "not_known")) == first["n_points"]
    )
    assert mapq("perturb", *args, "--seed", str(first["seed"]), "-f") == 0
    assert json.loads(capsys.readouterr().out) == first


def test_sub_maps_without_right_poses_are_registered(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "map.ply"
    odometry = str(folder.parent / "odometry.txt")
    files = [str(folder / f"{scan}.ply") for scan in (0, 1, 2, 3)]
    assert mapq("perturb", *files, "--poses", odometry, "--submaps", "--set", "scans.voxel=0.1", "-o", str(out)) == 0
    fields = read_cloud(str(out)).fields
    assert set(fields) == {"scan", "suspicious", "disagreement"}
    assert (fields["suspicious"] == 1).mean() > 0.9
    streams = capsys.readouterr()
    assert "labels from     registration\n" in streams.out
    assert "If these poses are right" in streams.err
