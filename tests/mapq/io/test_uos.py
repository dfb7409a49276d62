from __future__ import annotations

import pytest

from mapq.io import ReadOptions, read_cloud
from tests.mapq.io.samples import refusal, save

TEXT = "100 20 300 7\n-50 0 25 8\n"


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("head", ["", "2\n"])
def test_axes_and_centimetres(tmp_path, head, zipped):
    cloud = read_cloud(save(tmp_path, "scan000.3d", head + TEXT, zipped))
    assert cloud.xyz.tolist() == [[3.0, -1.0, 0.2], [0.25, 0.5, 0.0]]
    assert cloud.fields["column_4"].tolist() == [7.0, 8.0]


def test_another_unit(tmp_path):
    cloud = read_cloud(save(tmp_path, "scan000.3d", TEXT), ReadOptions(unit=1.0))
    assert cloud.xyz[0].tolist() == [300.0, -100.0, 20.0]


@pytest.mark.parametrize(
    ("text", "line"),
    [("3\n" + TEXT, "not the number of points, 2"), ("1 2\n", ":1: 2 columns"), ("1 2 x\n", ":1: '1 2 x'")],
)
def test_refusals(tmp_path, text, line):
    assert line in refusal(read_cloud, save(tmp_path, "scan000.3d", text))
