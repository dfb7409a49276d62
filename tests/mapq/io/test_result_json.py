from __future__ import annotations

import json

import pytest

from mapq.io.result_json import read_result_json
from mapq.io.results import SCHEMA, result_lines
from prf.shell.errors import InputError

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
    path.write_text("[]")
    with pytest.raises(InputError, match="not a JSON object"):
        read_result_json(path)
    path.write_text(json.dumps({"schema": SCHEMA, "patches": [1]}))
    with pytest.raises(InputError, match="no list of patches"):
        read_result_json(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        read_result_json(path)
    with pytest.raises(InputError, match="no such file"):
        read_result_json(tmp_path / "none.json")
