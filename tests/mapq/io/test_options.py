from __future__ import annotations

import numpy as np
import pytest

from mapq.io import ReadOptions, read_cloud, write_ply
from mapq.io.options import parse_unit
from prf.shell.errors import UsageError
from tests.mapq.io.samples import ply, save, table


@pytest.mark.parametrize(
    ("text", "metres"), [("m", 1.0), ("cm", 0.01), ("MM", 0.001), ("ft", 0.3048), ("us-ft", 1200 / 3937), ("2.5", 2.5)]
)
def test_units(text, metres):
    assert parse_unit(text) == metres


@pytest.mark.parametrize("text", ["", "yard", "0", "-1", "nan", "inf"])
def test_what_is_no_unit(text):
    with pytest.raises(ValueError, match=r"is no unit. Give one of m, cm, mm, ft, us-ft"):
        parse_unit(text)


@pytest.mark.parametrize("options", [{"unit": 0.0}, {"unit": float("nan")}, {"bin_columns": 5}])
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
