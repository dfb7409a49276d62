from __future__ import annotations

import json

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import ReadOptions, read_cloud, write_cloud
from mapq.io.results import SCHEMA, read_result_json, result_lines, stated_unit
from prf.shell.errors import InputError
from tests.mapq.io.samples import refusal

HEAD = {"unit": "m", "regions": [{"patches": [0, 2]}], "note": 'a "patches": [ in a text'}
ROWS = [{"patch": number, "label": "plausible", "text": 'ends with "]}\n'} for number in range(3)]


def save(path, rows=ROWS):
    path.write_text("".join(result_lines(HEAD, rows)), encoding="utf-8")
    return path


@pytest.mark.parametrize("rows", [ROWS, ROWS[:1], []])
def test_what_was_written_is_read(tmp_path, rows):
    head, found = read_result_json(save(tmp_path / "r.json", rows))
    assert head == {"schema": SCHEMA, **HEAD}
    assert list(found) == rows


@pytest.mark.parametrize("name", ["r.ply", "r.las"])
def test_a_result_is_read_in_the_unit_in_which_it_was_classified(tmp_path, name):
    """Neither format of another cloud than LAS can say it."""
    world = np.array([[500_000.5, 2000.0, 30.0], [500_400.0, 2500.0, 90.0]])
    fields = {"patch": np.zeros(2, np.int32), "suspicious": np.zeros(2, np.uint8)}
    path = str(tmp_path / name)
    result = PointCloud.from_world(world, {**fields, "p_suspicious": np.zeros(2, np.float32)}, unit=0.01)
    write_cloud(path, result)
    assert read_cloud(path).unit.tolist() == [1, 1, 1]
    (tmp_path / "r.json").write_text("".join(result_lines({**HEAD, "cloud_unit": [0.01] * 3}, ROWS)))
    again = read_cloud(path)
    assert again.unit.tolist() == [0.01] * 3
    np.testing.assert_allclose(again.xyz, result.xyz, atol=1e-5)
    np.testing.assert_allclose(again.world(), world, atol=1e-3)
    assert read_cloud(path, ReadOptions(unit=0.5)).unit.tolist() == [0.5] * 3
    write_cloud(path, PointCloud.from_world(world, fields))  # no result
    assert read_cloud(path).unit.tolist() == [1, 1, 1]


@pytest.mark.parametrize("unit", ["m", [1, 2]])
def test_what_is_no_unit_is_refused(tmp_path, unit):
    path = tmp_path / "r.json"
    path.write_text("".join(result_lines({**HEAD, "cloud_unit": unit}, ROWS)))
    assert "r.json: damaged" in refusal(stated_unit, path)


def test_json_without_unit_or_unreadable_is_ignored(tmp_path):
    path = tmp_path / "r.json"
    path.write_text("".join(result_lines(HEAD, ROWS)))
    assert stated_unit(path) is None
    path.write_text("{damaged")
    assert stated_unit(path) is None
    assert stated_unit(tmp_path / "none.json") is None
    assert stated_unit(tmp_path / f"{251 * 'a'}.json") is None


@pytest.mark.parametrize("indent", [None, 1])
def test_json_that_was_laid_out_anew_is_read_too(tmp_path, indent):
    path = save(tmp_path / "r.json")
    path.write_text(json.dumps(json.loads(path.read_text()), indent=indent))
    head, found = read_result_json(path)
    assert head == {"schema": SCHEMA, **HEAD}
    assert list(found) == ROWS


def test_patches_are_read_one_by_one(tmp_path):
    path = save(tmp_path / "r.json")
    path.write_text(path.read_text().replace('"patch": 2', '"patch": '))
    _, found = read_result_json(path)
    assert next(found) == ROWS[0]
    assert next(found) == ROWS[1]
    with pytest.raises(InputError, match=r"r\.json:4: damaged"):
        next(found)


@pytest.mark.parametrize("cut", [3, 4, 30, 200])
def test_a_file_that_was_cut_off_is_refused(tmp_path, cut):
    path = save(tmp_path / "r.json")
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(InputError, match=r"r\.json(:\d+)?: damaged"):
        list(read_result_json(path)[1])


def test_what_is_no_result_is_refused(tmp_path):
    path = save(tmp_path / "r.json")
    path.write_text(path.read_text().replace(SCHEMA, "mapq.result/7"))
    with pytest.raises(InputError, match=r"version 7 of .* is not known"):
        read_result_json(path)
    path.write_text(json.dumps({"schema": SCHEMA}))
    with pytest.raises(InputError, match="'patches' is missing"):
        read_result_json(path)
    with pytest.raises(InputError, match="no such file"):
        read_result_json(tmp_path / "none.json")
