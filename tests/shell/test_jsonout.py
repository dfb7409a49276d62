from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from prf.shell.cli.jsonout import dump_object, emit_object, emit_pieces


class Window(NamedTuple):
    x_min: float
    x_max: float


@dataclass
class Summary:
    path: Path
    window: Window


def test_schema_comes_first_and_numbers_that_are_none_become_null() -> None:
    text = dump_object("prf.info/1", {"a": math.nan, "b": [1, math.inf], "c": np.float64("nan"), "d": True})
    assert text == '{"schema": "prf.info/1", "a": null, "b": [1, null], "c": null, "d": true}'


def test_arrays_tuples_and_dataclasses_have_a_form() -> None:
    content = {
        "ranges": np.array([[1.5, np.inf]]),
        "n": np.int32(3),
        "ok": np.bool_(True),
        "summary": Summary(Path("a/b"), Window(0.0, 1.0)),
    }
    assert json.loads(dump_object("prf.info/1", content)) == {
        "schema": "prf.info/1",
        "ranges": [[1.5, None]],
        "n": 3,
        "ok": True,
        "summary": {"path": "a/b", "window": {"x_min": 0.0, "x_max": 1.0}},
    }


def test_what_has_no_form_is_refused() -> None:
    with pytest.raises(TypeError, match="set"):
        dump_object("prf.info/1", {"a": {1, 2}})


def test_one_line_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    emit_object("prf.info/1", {"a": "one\ntwo"})
    out, err = capsys.readouterr()
    assert out.count("\n") == 1
    assert err == ""


def test_pieces_of_an_object_become_one_line(capsys):
    emit_pieces(iter(['{"a": [', "\n1,", '\n"x\\n"', "\n]}\n"]))
    assert capsys.readouterr().out == '{"a": [1,"x\\n"]}\n'
