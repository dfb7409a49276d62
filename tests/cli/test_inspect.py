"""`prf inspect`: the manifest and the state of every file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from prf.cli import app
from prf.run import write_run
from prf.shell.run import run_app
from tests.factories import make_run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(tmp_path / "run", make_run())
    return tmp_path / "run"


def test_a_sound_run(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert run_app(app, "prf", ["inspect", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "configuration.scale" in shown
    assert "12 draws of 4 chains" in shown
    assert "checkpoint.npz    missing" in shown


def test_json(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert run_app(app, "prf", ["inspect", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.inspect/1"
    assert found["manifest"]["status"] == "finished"
    assert {file["name"]: file["state"] for file in found["files"]}["draws.npz"] == "ok"


def test_a_damaged_file_is_shown_and_fails(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "posterior.npz").write_bytes(b"PK broken")
    assert run_app(app, "prf", ["inspect", str(folder)]) == 3
    shown = capsys.readouterr()
    assert "posterior.npz     damaged" in shown.out
    assert "damaged: posterior.npz" in shown.err


def test_an_unknown_version_is_refused(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "manifest.json").write_text('{"schema": "prf.run/7"}')
    assert run_app(app, "prf", ["inspect", str(folder)]) == 3
    assert "version 7 of prf.run is not known" in capsys.readouterr().err
