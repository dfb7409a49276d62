"""Progress of Python calls, and the cards of notebooks."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from types import SimpleNamespace

import pytest
from PIL import Image

from prf.shell.cli import console
from prf.shell.cli.notebook import card, reported


def test_a_callable_receives_shares_and_words() -> None:
    calls: list[tuple[float, Mapping[str, object]]] = []
    with reported(lambda share, words: calls.append((share, words)), 4.0, "working") as reporter:
        reporter.update(1, stage="first")
        reporter.update(4)
    assert calls == [(0.25, {"stage": "first"}), (1.0, {})]


def test_no_progress_by_default(capsys: pytest.CaptureFixture[str]) -> None:
    with reported(False, 4.0, "working") as reporter:
        reporter.update(1, stage="first")
    assert capsys.readouterr() == ("", "")


def test_a_card_shows_facts_as_they_are_and_the_picture() -> None:
    page = card("A <b>map", {"source & more": "<script>"}, picture(3, 2))
    assert "A &lt;b&gt;map" in page
    assert "source &amp; more" in page
    assert "<script>" not in page
    assert "data:image/png;base64,iVBOR" in page
    assert "<img" not in card("A map", {})


def test_the_picture_of_a_card_is_a_small_copy() -> None:
    assert len(picture(2000, 1500)) > 1_000_000
    assert 10_000 < len(card("A map", {}, picture(2000, 1500))) < 100_000


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


def test_without_a_notebook_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert not console.in_notebook()
