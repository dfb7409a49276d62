from __future__ import annotations

import gzip

import pytest

from mapq.io import read_cloud
from mapq.io.recognise import ACCEPTED
from tests.mapq.io.samples import pcd, ply, refusal, save, table


def test_the_content_outranks_the_name(tmp_path):
    rows = table()
    for data in (ply(rows), pcd(rows), ply(rows, ""), pcd(rows, "ascii"), b"\xef\xbb\xbf" + ply(rows, "")):
        for name in ("a.txt", "a.las", "a", "a.bin", "a.ply", "a.pcd"):
            assert len(read_cloud(save(tmp_path, name, data))) == len(rows)


@pytest.mark.parametrize(
    ("name", "data", "line"),
    [
        ("a", b"LASF\0\0", "this is a LAS or LAZ file"),
        ("a.las", b"1 2 3", "this is a LAS file"),
        ("a.LAZ.gz", b"1 2 3", "this is a LAZ file"),
        ("a", b"ASTM-E57\1\0", "this is an E57 file"),
        ("a", b"#ROSBAG V2.0\n", "this is a ROS 1 bag"),
        ("a", b"\x89MCAP0\r\n", "this is a ROS 2 bag (MCAP)"),
        ("a", b"SQLite format 3\0", "perhaps a ROS 2 bag"),
        ("a.ptx", b"1 2 3", "this is a PTX file"),
        ("a", b"4\n5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n", "this is a PTX file"),
        ("a", b"# vtk DataFile Version 3.0\n", "this is a VTK file"),
        ("a.3d", b"1 2 3\n", "this is a 3DTK file, in centimetres and left-handed"),
        ("a", gzip.compress(gzip.compress(b"1 2 3", mtime=0), mtime=0), "gzipped twice"),
        ("a.ply", b"1 2 3\n", "no PLY header"),
        ("a.pcd", b"1 2 3\n", "no PCD header"),
        ("a.npy", b"1 2 3\n", "no NPY header"),
        ("a", b"\1\2\0\3", "binary data of an unknown kind"),
    ],
)
def test_what_is_not_read_is_named(tmp_path, name, data, line):
    message = refusal(read_cloud, save(tmp_path, name, data))
    assert line in message
    assert message.endswith(ACCEPTED)


def test_folders_missing_files_and_cut_archives(tmp_path):
    assert "folder, perhaps a ROS 2 bag" in refusal(read_cloud, str(tmp_path))
    assert "no such file" in refusal(read_cloud, str(tmp_path / "none.ply"))
    data = gzip.compress(b"1 2 3\n" * 99)
    assert "cut off at its end" in refusal(read_cloud, save(tmp_path, "a.gz", data[:-9]))
    assert "damaged" in refusal(read_cloud, save(tmp_path, "a.gz", data[:12] + b"\xff" * 9 + data[21:]))
