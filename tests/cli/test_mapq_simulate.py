"""The verb `mapq simulate`: its map, its numbers, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import SimulateSettings
from mapq.io import read_cloud, write_ply
from mapq.simulate import simulate
from tests.cli.calls import mapq
from tests.cli.mapq_samples import call, call_json
from tests.mapq.factories import wall
from tests.mapq.perturb.scenes import look, pose_at
from tests.shell.test_pose_files import rows

ARGS = ("simulate", "--size", "small", "--n-points", "4000")


def test_the_map_and_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.ply"
    assert mapq(*ARGS, "--seed", "2", "-o", str(path)) == 0
    cloud = read_cloud(str(path))
    made = simulate(SimulateSettings.of_size("small", {"n_points": 4000}), 2)
    np.testing.assert_array_equal(cloud.world(), made.world())
    for name, values in made.fields.items():
        np.testing.assert_array_equal(cloud.fields[name], values)
        assert cloud.fields[name].dtype == values.dtype
    table = capsys.readouterr().out
    assert f"points          {len(cloud):,}: " in table
    assert f"{made.fields['truth'].mean():.1%} of the points" in table
    assert table.endswith(f"seed            2\nmap             {path}\n")


def test_json_options_and_the_seed_that_was_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "map.ply"
    options = (
        "--drift",
        "0",
        "--set",
        "simulate.look_alikes=0",
        "--set",
        "simulate.clutter=0.5",
        "--set",
        "simulate.loops=1",
        "--json",
        "-o",
        str(path),
    )
    assert mapq(*ARGS, *options) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "mapq.simulate/1"
    assert (first["output"], first["passes"], first["final_drift"]) == (str(path), 2, 0.0)
    assert (first["suspicious_points"], first["look_alike_surfaces"]) == (0.0, 0.0)
    assert first["settings"]["loops"] == 1
    assert sum(first["points_by_kind"].values()) == first["points"]
    assert mapq(*ARGS, *options, "--seed", str(first["seed"]), "-f") == 0
    assert json.loads(capsys.readouterr().out) == first


# The verb `mapq perturb`: its map, its report, its parts, its refusals.


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


# Maps in tiles on the command line: folders of tiles, workers, cities, and what is refused.


CITY = ("simulate", "--size", "city", "--n-points", 147_000, "--seed", 5)


@pytest.fixture(scope="module")
def city(tmp_path_factory) -> Path:
    from mapq.simulate.city import write_city

    folder = tmp_path_factory.mktemp("map") / "city"
    write_city(folder, 147_000, 5)
    return folder


def test_a_city_is_made(capsys, tmp_path):
    target = tmp_path / "city"
    made = call_json(capsys, *CITY, "-o", target)
    assert (made["schema"], made["seed"], made["tiles"]) == ("mapq.city/1", 5, 1)
    assert made["points"] == len(read_cloud(str(target / "tile_000_000.laz")))
    code, _, err = call(capsys, *CITY, "-o", target)
    assert (code, "already exists" in err) == (4, True)
    code, out, _ = call(capsys, *CITY, "-o", target, "-f")
    assert code == 0
    assert "tiles           1 in" in out


@pytest.mark.slow
def test_a_folder_gives_a_folder(capsys, city):
    code, out, _ = call(capsys, "classify", city, "--fail-over", "1%", "--json")
    assert code == 1
    content = json.loads(out)
    target = city.with_name("city.classified")
    assert content["output"] == str(target)
    assert sorted(path.name for path in target.iterdir()) == ["result.json", "tile_000_000.laz"]
    stored = json.loads((target / "result.json").read_text())
    assert stored["patches"] == content["patches"]
    assert stored["verdict"] == content["verdict"]
    assert 0.0 < stored["verdict"]["coverage"] <= 1.0
    cloud = read_cloud(str(target / "tile_000_000.laz"))
    assert np.bincount(cloud.fields["patch"] + 1)[1:].tolist() == [row["n_points"] for row in stored["patches"]]
    code, _, err = call(capsys, "classify", city)
    assert (code, "already exists" in err) == (4, True)


@pytest.mark.slow
def test_two_workers_change_nothing(capsys, city, tmp_path):
    laz = city / "tile_000_000.laz"
    args = ["classify", laz, "--tile-points", 80_000, "-o"]
    for name, options in (("one.laz", []), ("two.laz", ["--workers", 2])):
        assert call(capsys, *args, tmp_path / name, *options)[0] == 0
    one, two = (read_cloud(str(tmp_path / name)) for name in ("one.laz", "two.laz"))
    np.testing.assert_array_equal(one.fields["patch"], two.fields["patch"])
    np.testing.assert_array_equal(one.fields["p_suspicious"], two.fields["p_suspicious"])
    rows = [json.loads((tmp_path / name).read_text())["patches"] for name in ("one.json", "two.json")]
    assert rows[0] == rows[1]


def test_a_damaged_tile_is_named(capsys, city, tmp_path):
    folder = tmp_path / "tiles"
    folder.mkdir()
    data = (city / "tile_000_000.laz").read_bytes()
    (folder / "whole.laz").write_bytes(data)
    (folder / "cut.laz").write_bytes(data[: len(data) // 2])
    code, _, err = call(capsys, "classify", folder, "-o", tmp_path / "out")
    assert (code, "cut.laz" in err, err.count("\n")) == (3, True, 1)
    assert not (tmp_path / "out").exists()
