"""The verb ``warm``: every job once for a state of the kernels, quietly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from prf.kernels._jit import CACHE
from prf.shell.cli import console
from tests.cli.calls import call


def test_a_job_runs_once_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CACHE, "folder", tmp_path / "cache")
    CACHE.folder.mkdir()
    first = call("prf warm --for points", tmp_path)
    assert (first.code, first.err, list(tmp_path.iterdir())) == (0, "compiling what points needs ...\n", [CACHE.folder])
    assert [path.name for path in CACHE.folder.glob("*.warm")] == ["points.warm"]
    second = call("prf warm --for points --json", tmp_path)
    assert (second.code, second.err, json.loads(second.out)["cache"]) == (0, "", str(CACHE.folder))
    assert console.settings.verbosity == 0


def test_an_unknown_job_is_a_usage_error(tmp_path: Path) -> None:
    done = call("mapq warm --for lasers", tmp_path)
    assert (done.code, done.err) == (2, "error: --for lasers: not one of classify, features.\n")
