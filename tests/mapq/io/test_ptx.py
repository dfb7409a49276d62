from __future__ import annotations

import numpy as np
import pytest

from mapq.axes import TO_SENSOR
from mapq.io import read_cloud
from tests.mapq.io.samples import refusal, save

TURNED = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (437_000.25, 5_428_000.5, 20, 1))
"""A quarter turn for row vectors, then a translation."""
PLAIN = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))


def ptx(rows: list[str], n_columns: int = 1, matrix=PLAIN, newline: str = "\n") -> str:
    head = [str(n_columns), str(len(rows) // n_columns), "0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    return newline.join([*head, *(" ".join(map(str, row)) for row in matrix), *rows, ""])


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_the_matrix_is_applied_and_empty_cells_left_out(tmp_path, newline, zipped):
    rows = ["1 2 3 0.5 10 20 255", "0 0 0 0.5 0 0 0", "-1.5 0 0 0.25 1 2 3", "4 5 6 1 7 8 9"]
    cloud = read_cloud(save(tmp_path, "a.ptx", ptx(rows, 2, TURNED, newline), zipped))
    expected = np.array([[-2, 1, 3], [0, -1.5, 0], [-5, 4, 6]]) + TURNED[3][:3]
    assert cloud.world().tolist() == expected.tolist()
    assert cloud.shift.tolist() == [436_000, 5_427_000, 0]
    assert cloud.fields["intensity"].tolist() == [0.5, 0.25, 1.0]
    assert (cloud.fields["blue"].dtype, cloud.fields["blue"].tolist()) == (np.uint8, [255, 3, 9])
    assert "scan" not in cloud.fields


def test_several_scans(tmp_path):
    text = ptx(["1 0 0 0.5", "2 0 0 0.5"]) + ptx(["1 0 0 0.75"], matrix=TURNED)
    cloud = read_cloud(save(tmp_path, "a.txt", text))
    assert cloud.fields["scan"].tolist() == [0, 0, 1]
    assert cloud.world()[2].tolist() == [437_000.25, 5_428_001.5, 20.0]
    assert list(cloud.fields) == ["intensity", "scan", *TO_SENSOR]
    assert cloud.fields["to_sensor_x"][:2].tolist() == [-1.0, -2.0]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (ptx(["1 2 3 0.5"] * 4)[:-4], ":14: '1 2 3' does not hold 4 numbers"),
        (ptx(["1 2 3 0.5"] * 4).replace("\n4\n", "\n9\n"), "promises 9 points, 4 follow"),
        (ptx(["1 2 3 0.5", "1 2 x 0.5"]), ":12: '1 2 x 0.5'"),
        (ptx(["1 2 3 0.5 1 2 256"]), ":11: '1 2 3 0.5 1 2 256'"),
        (ptx(["1 2"]), ":11: 2 columns; PTX has"),
        (ptx(["1 2 3 0.5"], matrix=np.array(TURNED).T), ":7: the last column of this matrix is not 0 0 0 1"),
        (ptx(["1 2 3 0.5"]) + "1\n", ":12: not the header of a scan"),
        (ptx(["1 2 3 0.5", "", "4 5 6 0.5"]), "promises 3 points, 2 follow"),
        (ptx(["0 0 0 0.5"]), "no points"),
    ],
)
def test_refusals(tmp_path, text, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.ptx", text))
