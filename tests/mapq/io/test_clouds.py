from __future__ import annotations

import gzip
import io
import logging
import sys

import numpy as np
import pytest

from mapq.configuration import ReadOptions, parse_unit
from mapq.io import read_cloud, write_ply
from mapq.io.content import ACCEPTED
from prf.shell.errors import UsageError
from tests.mapq.io.samples import pcd, ply, refusal, save, table, text_rows


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


@pytest.mark.parametrize(
    ("text", "metres"), [("m", 1.0), ("cm", 0.01), ("MM", 0.001), ("ft", 0.3048), ("us-ft", 1200 / 3937), ("2.5", 2.5)]
)
def test_units(text, metres):
    assert parse_unit(text) == metres


@pytest.mark.parametrize("text", ["", "yard"])
def test_what_is_no_unit(text):
    with pytest.raises(ValueError, match=r"must be one of m, cm, mm, ft, us-ft"):
        parse_unit(text)


@pytest.mark.parametrize(
    "options", [{"unit": 0.0}, {"unit": -1.0}, {"unit": float("inf")}, {"unit": float("nan")}, {"bin_columns": 5}]
)
def test_options_outside_their_domain(options):
    with pytest.raises(UsageError):
        ReadOptions(**options)


@pytest.mark.parametrize("unit", [0.01, 0.3048, 1200 / 3937])
def test_work_is_in_metres_and_the_result_in_the_unit_of_the_file(tmp_path, unit):
    rows = table()
    path = save(tmp_path, "a.ply", ply(rows))
    cloud = read_cloud(path, ReadOptions(unit=unit))
    np.testing.assert_array_equal(cloud.xyz[:, 0], rows["x"].astype(np.float64) * unit)
    write_ply(tmp_path / "b.ply", cloud)
    again = read_cloud(str(tmp_path / "b.ply"))
    assert again.xyz.tobytes() == read_cloud(path).xyz.tobytes()


ROWS = np.random.default_rng(0).normal(0, 1e5, (20, 5))
ROWS[3, 4] = np.nan


def as_text(delimiter: str, newline: str) -> str:
    return text_rows(ROWS.view("f8,f8,f8,f8,f8").reshape(-1), newline, delimiter)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("delimiter", [",", ";", " ", "\t", " , "])
@pytest.mark.parametrize("header", [None, "plain", "comment", "quoted", "bom"])
def test_layouts(tmp_path, header, delimiter, newline):
    sign = delimiter.strip() or " "
    names = {"quoted": '"x";"y";"z";"r i";"e"'.replace(";", sign) if sign != " " else '"x" "y" "z" "r_i" "e"'}
    plain = f" {sign} ".join("xyzie")
    head = {None: "", "plain": plain, "comment": f"# made by hand\n\n// {plain}", "bom": "\ufeff" + plain} | names
    text = (head[header] + "\n" if header else "") + as_text(delimiter, newline)
    cloud = read_cloud(save(tmp_path, "a.txt", text))
    assert np.array_equal(cloud.world(), ROWS[:, :3])
    wanted = {None: ["column_4", "column_5"], "quoted": ["r i" if sign != " " else "r_i", "e"]}
    assert list(cloud.fields) == wanted.get(header, ["i", "e"])
    for values, column in zip(cloud.fields.values(), ROWS.T[3:], strict=True):
        assert np.array_equal(values, column, equal_nan=True)


def test_three_columns_any_name_and_no_last_line_end(tmp_path):
    for name in ("a.xyz", "a.csv", "points", "a.log"):
        assert read_cloud(save(tmp_path, name, "1 2 3\n\n4 5 6")).xyz.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_standard_input(monkeypatch):
    class Stdin:
        buffer = io.BytesIO(b"x,y,z\n1,2,3\n")

    monkeypatch.setattr(sys, "stdin", Stdin)
    cloud = read_cloud("-")
    assert (len(cloud), cloud.source) == (1, "standard input")


def test_comments_anywhere(tmp_path):
    text = "# a\n//b\n1 2 3 # first\n# c\n4 5 6//second\n  // d\n7 8 9\n"
    assert len(read_cloud(save(tmp_path, "a.txt", text))) == 3
    text = "# x y z of the scan\n1 2 3\n"  # names nothing, since the rows have three columns
    assert read_cloud(save(tmp_path, "a.txt", text)).fields == {}


def test_header_of_cloudcompare(tmp_path):
    cloud = read_cloud(save(tmp_path, "a.asc", "//X Y Z R G B Scalar_field\n1 2 3 255 0 7 nan\n"))
    assert list(cloud.fields) == ["R", "G", "B", "Scalar_field"]
    assert cloud.xyz.tolist() == [[1, 2, 3]]


def test_columns_in_any_order(tmp_path):
    cloud = read_cloud(save(tmp_path, "a.csv", "time,z,y,x\n9,3,2,1\n"))
    assert cloud.xyz.tolist() == [[1, 2, 3]]
    assert list(cloud.fields) == ["time"]


def test_count_in_the_first_line(tmp_path):
    assert len(read_cloud(save(tmp_path, "a.pts", "2\n1 2 3 0.5 1 2 3\n4 5 6 0.5 1 2 3\n"))) == 2
    assert "promises 3 points, 2 follow" in refusal(read_cloud, save(tmp_path, "a.pts", "3\n1 2 3\n4 5 6\n"))


def test_delimiter_at_the_end_of_each_row(tmp_path):
    for head in ("", "x,y,z\n", "x,y,z,\n"):
        assert read_cloud(save(tmp_path, "a.csv", head + "1,2,3,\n4,5,6,\n")).fields == {}


def test_columns_of_words_are_dropped_with_a_warning(tmp_path, caplog):
    with caplog.at_level(logging.WARNING):
        cloud = read_cloud(save(tmp_path, "a.csv", "x,y,z,class,id\n1,2,3,car,5\n4,5,6,tree,6\n"))
    assert "field class is dropped" in caplog.text
    assert {name: values.tolist() for name, values in cloud.fields.items()} == {"id": [5, 6]}


@pytest.mark.parametrize(("n", "told"), [(2, "fields column_4, column_5 are"), (50, "column_23 and 30 more are")])
def test_many_columns_of_words_are_reported_in_one_line(tmp_path, caplog, n, told):
    read_cloud(save(tmp_path, "a.txt", ("1 2 3" + " word" * n + "\n") * 2))
    assert [record.message.endswith(f"{told} dropped: not numbers") for record in caplog.records] == [True]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (" \n\n", "the file is empty"),
        ("# only\n// comments\n", "no points"),
        ("a,b,c\n1,2,3\n", ":1: no fields x, y, z; there are a, b, c"),
        ("1 2\n3 4\n", "no fields x, y, z"),
        ("x,y,z,z2,z2\n1,2,3,4,5\n", "there are two fields z2"),
        ("x,y,z\n1,2,3,4\n", ":2: 4 columns under a header of 3"),
        ("1 2 3\n\n# more\n4 5 6 7\n", ":4: '4 5 6 7' does not hold 3 numbers"),
        ("x y z\n1 2 3\n4 5 1_0\n", ":3: '4 5 1_0' does not hold 3 numbers"),
        (
            "1;2;3\n1,5;2;3\n",
            ":2: '1,5;2;3' does not hold 3 numbers. Remove or correct this line; decimals need a point",
        ),
        ("nan nan nan\nnan 1 2\n", "all 2 points are nan or infinite"),
        ("1 2 3\n1 2 1e30\n", "z of point 1 is 1e+30, beyond 1e+09 m"),
        ("{}", "this is a JSON document"),
        ("1 2 3\n4 5 6\0", "binary data of an unknown kind"),
        ("\ufeff1 2 3".encode("utf-16"), "UTF-16"),
        ("Tall trees\nare no points\n", "no fields x, y, z"),
    ],
)
def test_refusals(tmp_path, text, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.txt", text))


def test_not_finite_points_are_rows(tmp_path):
    cloud = read_cloud(save(tmp_path, "a.txt", "1 2 3\nnan nan nan\ninf 2 -inf\n"))
    assert cloud.finite().tolist() == [True, False, False]
