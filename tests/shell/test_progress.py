from __future__ import annotations

import io
from collections.abc import Iterator

import pytest

from prf.shell.cli import console


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    console.reset()
    yield
    console.reset()


class Clock:
    """Stands in for the module `time`."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    stand_in = Clock()
    monkeypatch.setattr(console, "time", stand_in)
    return stand_in


def run(clock: Clock, n_updates: int, seconds_each: float) -> None:
    with console.progress(n_updates, "sampling") as bar:
        for done in range(1, n_updates + 1):
            clock.now += seconds_each
            bar(done, steps_per_second="150k")


def test_a_pipe_gets_a_plain_line_every_ten_seconds(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    run(clock, n_updates=50, seconds_each=0.5)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines() == [
        "sampling  40 %  steps per second 150k  elapsed 0:00:10  left 0:00:15",
        "sampling  80 %  steps per second 150k  elapsed 0:00:20  left 0:00:05",
    ]


def test_time_counts_from_the_start_of_the_command(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    console.reset("prf sample")
    assert console.settings.command == "prf sample"
    for description in ("compiling", "sampling"):
        with console.progress(None, description) as report:
            clock.now += 11.0
            report(1)
    assert capsys.readouterr().err.splitlines() == ["compiling  elapsed 0:00:11", "sampling  elapsed 0:00:22"]


def test_without_a_total_there_is_no_time_left() -> None:
    line = console.plain_line("sampling", 10, None, 61.0, None, {"rhat": "1.20"})
    assert line == "sampling  rhat 1.20  elapsed 0:01:01"


@pytest.mark.parametrize(("verbosity", "wanted"), [(-1, True), (0, False)])
def test_quiet_prints_nothing(clock: Clock, capsys: pytest.CaptureFixture[str], verbosity: int, wanted: bool) -> None:
    console.settings.verbosity, console.settings.progress = verbosity, wanted
    run(clock, n_updates=50, seconds_each=1.0)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(("wanted", "n_lines"), [(True, 2), (False, 0), (lambda share, fields: None, 0)])
def test_a_caller_who_wants_no_bar_gets_none(clock, capsys, wanted, n_lines) -> None:
    with console.progress_if(wanted):
        run(clock, n_updates=50, seconds_each=0.5)
    assert len(capsys.readouterr().err.splitlines()) == n_lines
    assert console.settings.progress


def test_a_terminal_gets_a_bar_on_stderr(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setattr("sys.stderr", terminal)
    with console.progress(10, "sampling") as bar:
        bar(5, rhat="[1.20]")
    assert "sampling" in terminal.getvalue()
    assert "rhat [1.20]" in terminal.getvalue(), "fields are text, not markup"
    assert capsys.readouterr().out == ""
