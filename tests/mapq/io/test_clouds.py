from __future__ import annotations

import gzip

import pytest

from mapq.io import read_cloud
from mapq.io.content import ACCEPTED
from tests.mapq.io.samples import pcd, ply, refusal, save, table


def test_the_content_outranks_the_name(tmp_path):
    rows = table()
    for data in (ply(rows), pcd(rows), ply(rows, ""), pcd(rows, "ascii"), b"\xef\xbb\xbf" + ply(rows, "")):
        for name in ("a.txt", "a.las", "a", "a.bin", "a.ply", "a.pcd"):
            assert len(read_cloud(save(tmp_path, name, data))) == len(rows)


@pytest.mark.parametrize(
    ("name", "data", "line"),
    [
        ("a.las", b"1 2 3", "no LAS header"),
        ("a.LAZ.gz", b"1 2 3", "no LAS header"),
        ("a.e57", b"1 2 3", "no E57 header"),
        ("a.bag", b"1 2 3", "no ROS bag header"),
        ("a", b"#ROSBAG V1.2\n", "a ROS 1 bag of an old version, which rosbag fix can convert"),
        ("a.ptx", b"1 2 3", "no PTX header"),
        ("a.vtk", b"# vtk DataFile Version 3.0\n", "a VTK file; save it as PLY"),
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
    assert "folder without metadata.yaml and with no bag file" in refusal(read_cloud, str(tmp_path))
    assert "no such file" in refusal(read_cloud, str(tmp_path / "none.ply"))
    data = gzip.compress(b"1 2 3\n" * 99)
    assert "cut off at its end" in refusal(read_cloud, save(tmp_path, "a.gz", data[:-9]))
    assert "damaged" in refusal(read_cloud, save(tmp_path, "a.gz", data[:12] + b"\xff" * 9 + data[21:]))
