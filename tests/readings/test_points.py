"""Point observations as CSV: what is read, and what is refused with its line."""

from __future__ import annotations

import gzip
import io
import sys
from pathlib import Path

import numpy as np
import pytest

from prf.readings import read_point_data
from prf.shell.errors import InputError


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "points.csv"


def test_columns_in_any_order_among_others(file: Path) -> None:
    file.write_text('\ufeff# soil\n\n"Value", station,Y , x\n0.5,a,2,1\n# later\n-1e3,b, 4 ,3\n')
    table = read_point_data(file)
    assert np.array_equal(table.xy, [[1.0, 2.0], [3.0, 4.0]])
    assert table.value.tolist() == [0.5, -1000.0]
    assert table.line.tolist() == [4, 6]
    assert table.source == str(file)


def test_gzip_and_standard_input(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = b"x,y,value\n1,2,0\n3,4,1\n"
    file.write_bytes(gzip.compress(text))
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text)))
    for table in (read_point_data(file), read_point_data("-")):
        assert np.array_equal(table.xy, [[1.0, 2.0], [3.0, 4.0]])
        assert table.value.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "points.csv: the file is empty."),
        ("1,2,3\n4,5,6\n", "points.csv:1: the header has no column x, y, value."),
        ("x,y,value\n1,2,black\n", "points.csv:2: could not convert string 'black' to float64."),
        ("x,y,value\n1,2,3\n\n1,2,nan\n", "points.csv:4: value is nan, but must be a finite number."),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(file: Path, text: str, words: str) -> None:
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        read_point_data(file)
    assert words in str(caught.value)


def test_files_that_are_no_text(file: Path, tmp_path: Path) -> None:
    file.write_bytes(gzip.compress(b"x,y,value\n1,2,3\n")[:-9])
    with pytest.raises(InputError, match="cut off"):
        read_point_data(file)
    for missing in (tmp_path / "absent.csv", tmp_path):
        with pytest.raises(InputError, match=missing.name):
            read_point_data(missing)


def test_values_that_are_no_colours_are_named_with_their_line(file: Path) -> None:
    file.write_text("x,y,value\n1,2,0\n1,2,1\n\n3,4,0.3\n")
    table = read_point_data(file)
    with pytest.raises(InputError, match=r"points.csv:5: value is 0\.3, but binary"):
        table.refuse_other_than_colours()
    table._replace(value=np.array([0.0, 1.0, 1.0])).refuse_other_than_colours()
