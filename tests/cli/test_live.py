"""`prf sample --live` on a real pseudo-terminal, and in a pipe, where it changes nothing."""

from __future__ import annotations

import contextlib
import io
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from prf.cli import app
from prf.run import read_run
from prf.shell.run import run_app
from tests.shell.terminals import ESCAPE, run_on_terminal

QUICK = (
    "--every-scan",
    "8",
    "--every-beam",
    "6",
    "--chains",
    "2",
    "--resolution",
    "0.5",
    "--seed",
    "5",
    "--threads",
    "1",
)


def in_a_pipe(*args: object) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of `prf` where none of its streams is a terminal."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_app(app, "prf", [*map(str, args)])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def log() -> Path:
    return Path(__file__).resolve().parents[2] / "data" / "demo-office.log.gz"


@pytest.fixture(scope="module")
def plain(log: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What a run without --live prints, in a pipe, and where it is."""
    folder = tmp_path_factory.mktemp("plain")
    with contextlib.chdir(folder):
        code, out, _ = in_a_pipe("sample", "--laser", log, *QUICK, "--steps", "20000", "-o", "office")
    assert code == 0
    return out, folder / "office"


def test_it_draws_on_standard_error_and_changes_nothing_else(
    log: Path, plain: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    args = ("--laser", log, *QUICK, "--steps", "20000", "-o", "office", "--live")
    code, written = run_on_terminal("prf", "sample", *args, size=(30, 100), stdout=tmp_path / "out")
    assert code == 0
    assert (tmp_path / "out").read_text() == plain[0]
    seen = ESCAPE.sub("", written)
    assert "office: 2 chains" in seen
    assert "step 20,000" in seen, "the last picture is that of the end"
    assert "proposals" in seen
    assert "▀" in seen
    assert "\x1b[38;2;" in written
    assert "\x1b[?25h" in written, "the cursor is back"
    ours, theirs = read_run("office"), read_run(plain[1])
    for name, values in theirs.functionals.items():
        np.testing.assert_array_equal(ours.functionals[name], values)
    assert ours.image is not None
    assert theirs.image is not None
    np.testing.assert_array_equal(ours.image.occupancy, theirs.image.occupancy)


def test_the_best_map_is_drawn_while_it_is_looked_for(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    args = ("--laser", log, *QUICK[:6], "--seed", "5", "--steps", "20000", "-o", "best.geojson")
    code, written = run_on_terminal("prf", "anneal", *args, "--live", stdout=tmp_path / "out")
    assert code == 0
    seen = ESCAPE.sub("", written)
    assert "best.geojson: best of 2 chains" in seen
    assert "temperature" in seen
    assert "▀" in seen
    shown = (tmp_path / "out").read_text().splitlines()
    code, out, err = in_a_pipe("anneal", *args, "--force", "--live")
    # The file has the command line in it, and so another size.
    assert [row for row in out.splitlines() if not row.startswith("size")] == shown[:2] + shown[3:]
    assert "\x1b" not in err


def test_in_a_pipe_there_are_the_usual_lines(
    log: Path, plain: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = in_a_pipe("sample", "--laser", log, *QUICK, "--steps", "20000", "-o", "office", "--live")
    assert (code, out) == (0, plain[0])
    assert "\x1b" not in err


def test_without_colours_it_has_shades_and_ctrl_c_ends_it_in_good_order(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sent = []

    def interrupt(process: subprocess.Popen[bytes], written: str) -> None:
        if "proposals" in written and not sent:
            sent.append(True)
            process.send_signal(signal.SIGINT)

    args = ("--laser", log, *QUICK, "--time-budget", "200", "-o", "office", "--live")
    code, written = run_on_terminal("prf", "sample", *args, environment={"NO_COLOR": "1"}, act=interrupt)
    assert code == 130
    assert "stopping in good order" in written
    assert "office is valid" in ESCAPE.sub("", written)
    assert written.rindex("\x1b[?25h") > written.rindex("\x1b[?25l"), "the cursor is back"
    assert read_run("office").manifest["status"] == "interrupted"
    assert "\x1b[38" not in written
    assert "\x1b[48" not in written
    assert {"█", "░"} <= set(written)
