from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image

from prf.shell.cli import console
from prf.shell.cli.console import reported
from prf.shell.cli.pictures import card
from prf.shell.cli.storage import dump_object, emit_object, emit_pieces


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


# Progress of Python calls, and the cards of notebooks.


def test_a_callable_receives_shares_and_words() -> None:
    calls: list[tuple[float, Mapping[str, object]]] = []
    with reported(lambda share, words: calls.append((share, words)), 4.0, "working") as reporter:
        reporter(1, stage="first")
        reporter(4)
    assert calls == [(0.25, {"stage": "first"}), (1.0, {})]


def test_a_card_shows_facts_as_they_are_and_the_picture() -> None:
    page = card("A <b>map", {"source & more": "<script>"}, picture(3, 2))
    assert "A &lt;b&gt;map" in page
    assert "source &amp; more" in page
    assert "<script>" not in page
    assert "data:image/png;base64,iVBOR" in page
    assert "<img" not in card("A map", {})


def picture(width: int, height: int) -> bytes:
    """Return noise, which no format can pack."""
    buffer = io.BytesIO()
    Image.effect_noise((width, height), 100.0).save(buffer, "png")
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("shell", "widgets", "is_one"), [("ZMQ", True, True), ("ZMQ", False, False), ("T", True, False)]
)
def test_a_notebook_is_known_by_its_shell(
    monkeypatch: pytest.MonkeyPatch, shell: str, widgets: bool, is_one: bool
) -> None:
    running = type(f"{shell}InteractiveShell", (), {})()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: running))  # type: ignore[arg-type]
    monkeypatch.setattr(console, "find_spec", lambda name: object() if widgets else None)
    assert console.in_notebook() is is_one
