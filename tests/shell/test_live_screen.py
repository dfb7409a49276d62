"""Pictures in place: in another thread, not too often, and what goes wrong in them is told."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import pytest
from rich.text import Text

from prf.shell import console
from prf.shell.terminal import Screen, live
from prf.shell.terminal.live import LiveScreen
from tests.shell.terminals import ESCAPE, Stream


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    console.reset()
    monkeypatch.setenv("TERM", "xterm-256color")
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    yield
    console.reset()


class Clock:
    """Stands in for the module `time`; work takes time of the processor, and of the clock."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    process_time = monotonic

    def thread_time(self) -> float:
        return self.now


def test_the_latest_picture_stands_and_messages_go_above(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = Stream(True)
    monkeypatch.setattr("sys.stderr", stream)
    with LiveScreen(stream) as screen:
        screen.show(lambda size: [Text(f"first, {size.columns} columns")])
        console.report_error("a message")
        screen.show(lambda size: [Text("second")])
    seen = ESCAPE.sub("", stream.text()).replace("\r", "")
    assert seen.index("first, 80 columns") < seen.index("a message") < seen.index("second")
    assert seen.endswith("second\n")
    assert stream.text().rstrip().endswith("\x1b[?25h"), "the cursor is back"


def test_pictures_come_twice_a_second_at_most_and_take_a_small_share(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(live, "time", clock)

    def dear(_: Screen) -> list[Text]:
        clock.now += 0.1
        return [Text("picture")]

    with LiveScreen(Stream(True)) as screen:
        shown = []
        while clock.now < 130.0:
            if screen.is_due:
                shown.append(clock.now)
                screen.show(dear, spent=0.1)
                assert screen._latest is not None
                screen._latest.result()
            clock.now += 0.05
    apart = [later - earlier for earlier, later in pairwise(shown)]
    assert min(apart) >= live.PERIOD
    assert 0.2 * (len(shown) - 1) <= live.SHARE * (shown[-1] - 100.0) + 0.2
    assert len(shown) >= 3


def test_a_cheap_picture_comes_whenever_the_time_has_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock()
    monkeypatch.setattr(live, "time", clock)
    with LiveScreen(Stream(True)) as screen:
        assert screen.is_due
        screen.show(lambda size: [Text("picture")])
        assert screen._latest is not None
        screen._latest.result()
        assert not screen.is_due
        clock.now += live.PERIOD
        assert screen.is_due


def test_one_picture_at_a_time() -> None:
    with LiveScreen(Stream(True)) as screen:
        screen.show(lambda size: time.sleep(0.3) or [Text("slow")])  # type: ignore[func-returns-value]
        assert not screen.is_due


def test_what_goes_wrong_in_a_picture_is_told_at_the_end() -> None:
    def bad(_: Screen) -> list[Text]:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), LiveScreen(Stream(True)) as screen:
        screen.show(bad)


def test_only_a_terminal_that_can_redraw_shows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert LiveScreen.can_show(Stream(True))
    assert not LiveScreen.can_show(Stream(False))
    console.settings.verbosity = -1
    assert not LiveScreen.can_show(Stream(True))
    console.reset()
    console.settings.progress = False
    assert not LiveScreen.can_show(Stream(True))
    console.reset()
    monkeypatch.setenv("TERM", "dumb")
    assert not LiveScreen.can_show(Stream(True))
