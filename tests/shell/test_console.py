from __future__ import annotations

import io
import logging
from collections.abc import Iterator

import pytest

from prf.shell.cli import console
from prf.shell.cli.console import ColorChoice


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    console.reset()
    yield
    console.reset()


class TestColor:
    def test_terminals_only(self) -> None:
        assert console.use_color(Terminal())
        assert not console.use_color(io.StringIO())

    @pytest.mark.parametrize(
        ("variables", "choice", "wanted"),
        [
            ({"NO_COLOR": "1"}, "auto", False),
            ({"NO_COLOR": ""}, "auto", True),
            ({"TERM": "dumb"}, "auto", False),
            ({"NO_COLOR": "1"}, "always", True),
            ({"FORCE_COLOR": "1"}, "never", False),
            ({"FORCE_COLOR": "1", "TERM": "dumb"}, "auto", True),
            ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, "auto", False),
        ],
    )
    def test_precedence_on_a_terminal(
        self, monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], choice: ColorChoice, wanted: bool
    ) -> None:
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        console.settings.color = choice
        assert console.use_color(Terminal()) is wanted


class TestLog:
    @pytest.mark.parametrize(
        ("verbosity", "shown"),
        [(-1, ["error"]), (0, ["info", "warning", "error"]), (1, ["debug", "info", "warning", "error"])],
    )
    def test_verbosity_decides_what_is_shown_on_stderr(
        self, capsys: pytest.CaptureFixture[str], verbosity: int, shown: list[str]
    ) -> None:
        console.settings.verbosity = verbosity
        console.configure()
        logger = logging.getLogger("prf.somewhere")
        for level in ("debug", "info", "warning", "error"):
            getattr(logger, level)("said at %s", level)
        out, err = capsys.readouterr()
        assert out == ""
        assert [line.split()[-1] for line in err.splitlines()] == shown

    def test_warnings_are_marked(self, capsys: pytest.CaptureFixture[str]) -> None:
        logging.getLogger("prf.somewhere").warning("poses jump")
        assert capsys.readouterr().err == "warning: poses jump\n"


def test_an_error_is_one_line_whatever_it_holds(capsys: pytest.CaptureFixture[str]) -> None:
    console.report_error("first\nsecond   third\n")
    assert capsys.readouterr().err == "error: first second third\n"


def test_a_table_leaves_standard_output_to_the_output_there(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console.settings, "verbosity", 0)
    # What a command configured before would keep from the handlers of the root.
    monkeypatch.setattr(logging.getLogger("prf"), "propagate", True)
    with caplog.at_level(logging.INFO, "prf"):
        console.say_beside("-")("a line")
    assert (capsys.readouterr().out, set(caplog.messages)) == ("", {"a line"})
    for output in ("maps.npz", None):
        console.say_beside(output)("a line")
        assert capsys.readouterr().out == "a line\n"
    monkeypatch.setattr(console.settings, "verbosity", -1)
    console.say_beside("maps.npz")("a line")
    assert capsys.readouterr().out == ""
    console.say_beside(None)("a line")
    assert capsys.readouterr().out == "a line\n"
