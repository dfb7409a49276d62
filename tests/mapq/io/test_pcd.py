from __future__ import annotations

import sys

import numpy as np
import pypcd4
import pytest

from mapq.io import read_cloud, write_ply
from tests.mapq.io.samples import check_same, pcd, pcd_header, refusal, save, table

ENCODINGS = ["ascii", "binary", "binary_compressed"]
PADDED = np.dtype(
    [
        *(("x", "f4"), ("y", "f4"), ("z", "f4"), ("pad0", "u1", (4,)), ("intensity", "f4"), ("fpfh", "f4", (3,))),
        *(("ring", "u2"), ("pad1", "u1", (10,)), ("stamp", "u8")),
    ]
)


def padded(n: int = 40) -> np.ndarray:
    rng = np.random.default_rng(0)
    rows = np.frombuffer(rng.bytes(n * PADDED.itemsize), PADDED).copy()
    for name in ("x", "y", "z", "intensity", "fpfh"):
        rows[name] = rng.normal(size=rows[name].shape)
    return rows


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("coordinates", ["f4", "f8"])
@pytest.mark.parametrize("data", ENCODINGS)
def test_every_type(tmp_path, data, coordinates, zipped):
    rows = table(coordinates=coordinates)
    check_same(read_cloud(save(tmp_path, "a.pcd", pcd(rows, data), zipped)), rows)


@pytest.mark.parametrize("data", ENCODINGS)
def test_padding_and_counts(tmp_path, data):
    rows = padded()
    cloud = read_cloud(save(tmp_path, "a.pcd", pcd(rows, data)))
    check_same(cloud, rows, skip=("pad0", "pad1"))
    assert cloud.fields["fpfh"].shape == (len(rows), 3)
    write_ply(tmp_path / "a.ply", cloud)
    names = list(read_cloud(str(tmp_path / "a.ply")).fields)
    assert names == ["intensity", "fpfh_0", "fpfh_1", "fpfh_2", "ring", "stamp"]


@pytest.mark.parametrize("data", ENCODINGS)
def test_as_pypcd4_reads_and_writes_it(tmp_path, data):
    rows = np.repeat(table(), 5)  # what does not compress, pypcd4 writes as plain binary
    path = str(tmp_path / "a.pcd")
    columns = [rows[name] for name in rows.dtype.names]
    types = [rows.dtype[name] for name in rows.dtype.names]
    written = pypcd4.PointCloud.from_points(columns, rows.dtype.names, types)
    written.save(path, pypcd4.Encoding(data))
    cloud = read_cloud(path)
    if data != "ascii":  # it writes ten digits
        check_same(cloud, rows)
    ours = pypcd4.PointCloud.from_path(save(tmp_path, "b.pcd", pcd(rows, data)))
    for name in rows.dtype.names:
        assert ours.pc_data[name].tobytes() == np.ascontiguousarray(rows[name]).tobytes()


def test_packed_colours_keep_their_bits(tmp_path):
    packed = np.array([0xFF0000, 0xFFFFFFFF, 0xFF7F8001, 0x00000001, 0x7F800001], np.uint32)
    rows = np.zeros(5, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("rgb", "f4")])
    rows["rgb"] = packed.view(np.float32)
    for data in ("binary", "binary_compressed"):
        path = str(tmp_path / "b.ply")
        write_ply(path, read_cloud(save(tmp_path, "a.pcd", pcd(rows, data))))
        assert read_cloud(path).fields["rgb"].view(np.uint32).tolist() == packed.tolist()


@pytest.mark.parametrize(
    "replaced",
    [
        {"WIDTH": "0", "HEIGHT": "0"},
        {"POINTS": ""},
        {"WIDTH": "", "HEIGHT": ""},
        {"WIDTH": "10", "HEIGHT": "5"},
        {"COUNT": ""},
        {"VERSION": ".7", "VIEWPOINT": ""},
    ],
)
@pytest.mark.parametrize("data", ENCODINGS)
def test_headers_of_the_wild(tmp_path, data, replaced):
    rows = table()
    check_same(read_cloud(save(tmp_path, "a.pcd", pcd(rows, data, **replaced))), rows)


def test_text_with_tabs_and_crlf(tmp_path):
    rows = table()
    data = pcd(rows, "ascii").replace(b" ", b"\t  ").replace(b"\n", b" \r\n")
    check_same(read_cloud(save(tmp_path, "a.pcd", data)), rows)


def test_upper_case_coordinates_and_no_first_comment(tmp_path):
    rows = table()
    data = pcd(rows, FIELDS=" ".join(["X", "Y", "Z", *rows.dtype.names[3:]]))
    check_same(read_cloud(save(tmp_path, "a.dat", data.partition(b"\n")[2])), rows)


def test_data_that_an_old_program_left_uncompressed(tmp_path):
    rows = table(8)
    raw = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    sizes = np.array([len(raw), len(raw)], "<u4").tobytes()
    for word in ("binary_compressed", "binaryscompressed"):
        data = pcd_header(rows, word).encode() + sizes + raw
        check_same(read_cloud(save(tmp_path, "a.pcd", data)), rows)


@pytest.mark.parametrize(
    ("replaced", "line"),
    [
        ({"FIELDS": "a b c d e f g h i j k"}, "no fields x, y, z; there are a, b"),
        ({"FIELDS": "x y z"}, "do not match"),
        ({"FIELDS": "x y z z e f g h i j k"}, "there are two fields z"),
        ({"TYPE": "F F F I U I U I U F Q"}, "damaged"),
        ({"SIZE": "4 4 4 1 1 2 2 4 4 4 3"}, "damaged"),
        ({"POINTS": "50", "WIDTH": "49"}, "POINTS is 50, but WIDTH x HEIGHT is 49"),
        ({"POINTS": "51", "WIDTH": "51"}, ""),
        ({"POINTS": "-3"}, "POINTS '-3' of the PCD header is not a count"),
        ({"POINTS": "", "WIDTH": ""}, "neither POINTS nor WIDTH"),
        ({"DATA": "morse"}, "DATA 'morse' is not known"),
        ({"DATA": ""}, "has no DATA line"),
    ],
)
@pytest.mark.parametrize("data", ENCODINGS)
def test_refusals(tmp_path, data, replaced, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.pcd", pcd(table(), data, **replaced)))


def test_text_that_is_not_as_promised(tmp_path):
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n"
    for body, line in [
        ("1 2 3\n", "promises 2 points, 1 follow"),
        ("1 2 3\n4 5 6\n7 8 9\n", "promises 2 points, 3 follow"),
        ("1 2 3\n4 5\n", ":9: '4 5' does not hold 3 numbers"),
        ("1 2 3\n4 5 six\n", ":9: '4 5 six'"),
        ("", "promises 2 points, 0 follow"),
    ]:
        assert line in refusal(read_cloud, save(tmp_path, "a.pcd", head + body))


def test_without_lzf_the_extra_is_named(tmp_path, monkeypatch):
    path = save(tmp_path, "a.pcd", pcd(table(), "binary_compressed"))
    monkeypatch.setitem(sys.modules, "lzf", None)
    assert "pip install '.[pcd]'; elsewhere: pip install 'python-neo-lzf>=" in refusal(read_cloud, path)
