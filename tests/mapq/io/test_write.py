"""Results in the format of their input: PCD and text; tests of PLY and LAS are in test_ply_and_pcd.py, test_las.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pypcd4 import PointCloud as Pcd

from mapq.cloud import PointCloud
from mapq.io import read_cloud, write_cloud
from mapq.io.results import result_cloud
from mapq.io.write import written_suffix
from prf.shell.errors import OutputError

N = 40


def cloud_of(kind: type = np.float32, offset: float = 0.0) -> PointCloud:
    rng = np.random.default_rng(2)
    fields = {
        "intensity": rng.normal(0.0, 30.0, N).astype(np.float32),
        "ring": rng.integers(0, 64, N).astype(np.uint16),
        "stamp": rng.uniform(0.0, 1e9, N),
        "flag": rng.random(N) < 0.5,
        "normal": rng.normal(size=(N, 3)),
        "two words": np.arange(N),
        "nothing": np.full(N, np.nan, np.float32),
        "negative zero": np.full(N, -0.0),
    }
    world = (rng.normal(0.0, 20.0, (N, 3)) + offset).astype(kind)
    return PointCloud.from_world(world, fields)


def labelled(cloud: PointCloud) -> PointCloud:
    patch = np.where(np.arange(N) % 4 == 3, -1, np.arange(N) % 4).astype(np.int32)
    return result_cloud(cloud, patch, np.array([0, 1, 0], np.uint8), np.array([0.1, 0.9, 0.2], np.float32))


@pytest.mark.parametrize("suffix", [".pcd", ".csv", ".xyz", ".txt", ".asc"])
@pytest.mark.parametrize(("kind", "offset"), [(np.float32, 0.0), (np.float64, 5e6)])
def test_what_is_written_is_read_back_to_the_last_bit(tmp_path: Path, suffix: str, kind: type, offset: float) -> None:
    cloud = labelled(cloud_of(kind, offset))
    path = str(tmp_path / f"r{suffix}")
    write_cloud(path, cloud)
    again = read_cloud(path)
    assert again.world().tobytes() == cloud.world().tobytes()
    names = ["intensity", "ring", "stamp", "flag", "normal_0", "normal_1", "normal_2"]
    names += ["two_words", "nothing", "negative_zero"]
    assert list(again.fields) == [*names, "patch", "suspicious", "p_suspicious", "red", "green", "blue"]
    before = [column for values in cloud.fields.values() for column in values.reshape(N, -1).T]
    for values, old in zip(again.fields.values(), before, strict=True):
        np.testing.assert_array_equal(values.astype(old.dtype), old)
    assert np.signbit(again.fields["negative_zero"]).all()


def test_another_program_reads_the_pcd_and_finds_colours_where_pcl_has_them(tmp_path: Path) -> None:
    cloud = labelled(cloud_of().with_fields(rgb=np.arange(N, dtype=np.float32)))
    write_cloud(str(tmp_path / "r.pcd"), cloud)
    found = Pcd.from_path(tmp_path / "r.pcd")
    np.testing.assert_array_equal(found.numpy(("x", "y", "z")), cloud.world().astype(np.float32))
    np.testing.assert_array_equal(found.pc_data["suspicious"], cloud.fields["suspicious"])
    bits = np.ascontiguousarray(found.pc_data["rgb"]).view(np.uint32)
    np.testing.assert_array_equal(bits >> 16 & 255, cloud.fields["red"])
    np.testing.assert_array_equal(bits & 255, cloud.fields["blue"])
    again = read_cloud(str(tmp_path / "r.pcd"))
    assert "rgb" not in again.fields
    np.testing.assert_array_equal(again.fields["original_rgb"], np.arange(N))


def test_a_pcd_keeps_an_rgb_that_does_not_repeat_its_colours(tmp_path: Path) -> None:
    cloud = cloud_of().with_fields(rgb=np.arange(N, dtype=np.float32))
    write_cloud(str(tmp_path / "a.pcd"), cloud)
    np.testing.assert_array_equal(read_cloud(str(tmp_path / "a.pcd")).fields["rgb"], np.arange(N))


def test_text_is_what_spreadsheets_and_cloudcompare_expect(tmp_path: Path) -> None:
    fields = {"ring, upper": np.array([3.0]), "p": np.array([0.1], "f4")}
    cloud = PointCloud.from_world(np.array([[1.5, 0.1, 2.0]]), fields)
    write_cloud(str(tmp_path / "a.csv"), cloud)
    assert (tmp_path / "a.csv").read_text() == "x,y,z,ring__upper,p\n1.5,0.1,2.0,3,0.1\n"
    write_cloud(str(tmp_path / "a.xyz"), cloud)
    assert (tmp_path / "a.xyz").read_text() == "//x y z ring__upper p\n1.5 0.1 2.0 3 0.1\n"


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    for suffix in (".pcd", ".csv"):
        with pytest.raises(OutputError):
            write_cloud(str(tmp_path / "no" / f"a{suffix}"), cloud_of())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "suffix", "n_lines"),
    [("a.LAZ", ".laz", 0), ("a.copc.laz", ".laz", 0), ("a.csv.gz", ".csv", 0), ("a.e57", ".ply", 1), ("a", ".ply", 0)],
)
def test_a_copy_keeps_the_format_that_is_written(name: str, suffix: str, n_lines: int, caplog) -> None:
    caplog.set_level("INFO")
    assert written_suffix(name) == suffix
    assert len(caplog.records) == n_lines
    assert all("E57 is read, not written; the default output is a PLY" in each.message for each in caplog.records)
