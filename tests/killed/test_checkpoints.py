"""A run that is killed between any two of its files: absent, or resumed to the same bytes."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from prf.cli import app
from prf.sampler import session
from prf.shell import files
from prf.shell.run import run_app
from tests.killed.child import ROOT

LOG = str(ROOT / "data" / "demo-office.log.gz")
QUICK = ("--every-scan", "20", "--every-beam", "12", "--chains", "2", "--resolution", "1", "--seed", "1", "-q")
STEPS = ("--steps", "24000")
SAME = ("draws.npz", "posterior.npz", "readings.npz", "map.geojson", "checkpoint.npz", "posterior.png")


class Killed(BaseException):
    """What no code of ours may catch and go on."""


def sample(*args: object) -> int:
    return run_app(app, "prf", ["sample", *map(str, args)])


def begin(folder: Path) -> int:
    return sample("--laser", LOG, *QUICK, *STEPS, "-o", folder)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "a.run"
    assert begin(folder) == 0
    return folder


def killed_before(name: str, nth: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Begin a run that checkpoints all the time; end it where a file takes its place the n-th time, leaving it beside.

    With -1 it is the last time: the picture, which comes before the last manifest, stands already.
    """
    seen = 0

    def replace(source: str, target: Path) -> None:
        nonlocal seen
        if target.name == name:
            is_last = (folder / "posterior.png").exists()
            if is_last if nth < 0 else seen == nth:
                raise Killed
            seen += 1
        os.rename(source, target)

    def unlink(path: Path, missing_ok: bool = False) -> None:
        if path.suffix != ".tmp" and (path.exists() or not missing_ok):
            os.remove(path)

    with monkeypatch.context() as patched:
        patched.setattr(session, "CHECKPOINT_SECONDS", 0.0)
        patched.setattr(files.os, "replace", replace)
        patched.setattr(files.Path, "unlink", unlink)
        with pytest.raises(Killed):
            begin(folder)


def end(folder: Path) -> int:
    """Do what a user would: go on with what is a run, else the same again."""
    if (folder / "manifest.json").exists():
        return sample("--resume", folder, *STEPS, "-q")
    return begin(folder)


@pytest.mark.parametrize(
    ("name", "nth", "is_run"),
    [
        ("manifest.json", 0, False),
        ("posterior.png", 0, True),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (
                ("checkpoint.npz", 0, False),
                ("checkpoint.npz", 1, True),
                ("posterior.npz", 1, True),
                ("manifest.json", -1, True),
            )
        ),
    ],
)
def test_killed_before_a_file_takes_its_place(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, nth: int, is_run: bool
) -> None:
    folder = tmp_path / "a.run"
    killed_before(name, nth, folder, monkeypatch)
    assert (folder / "manifest.json").exists() == is_run
    assert list(folder.glob(".*.tmp"))
    assert end(folder) == 0
    assert [each for each in SAME if (folder / each).read_bytes() != (whole / each).read_bytes()] == []
    assert json.loads((folder / "manifest.json").read_text())["status"] == "finished"
    assert list(tmp_path.rglob(".*")) == []
