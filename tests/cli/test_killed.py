"""A verb that is killed at any time leaves an old result, a new one, or none; a run that is killed can be resumed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from prf.sampler import session
from prf.shell.cli import files
from tests.cli.calls import VERBS, Verb, call
from tests.conftest import ROOT

LOG = ROOT / "data" / "demo-office.log.gz"
RUN = f"--laser {LOG} --every-scan 20 --every-beam 12 --chains 2 --resolution 1 --seed 1"
STEPS = "--steps 24000 -q"
SAME = ("draws.npz", "posterior.npz", "readings.npz", "map.geojson", "checkpoint.npz", "posterior.png")


class Killed(BaseException):
    """Ends a call as a signal does: no code of ours may catch it."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    assert call(f"prf sample {RUN} {STEPS} -o a.run", folder).code == 0
    return folder / "a.run"


def kill_before(name: str, nth: int, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Start a run that checkpoints all the time, and end it before the file `name` is renamed for the n-th time."""
    seen = 0

    def replace(source: str, target: Path) -> None:
        nonlocal seen
        if target.name == name:
            if seen == nth:
                raise Killed
            seen += 1
        os.rename(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(session, "CHECKPOINT_SECONDS", 0.0)
        patched.setattr(files.os, "replace", replace)
        patched.setattr(files, "remove_temporary", lambda path: None)  # as a killed process leaves them
        with pytest.raises(Killed):
            call(f"prf sample {RUN} {STEPS} -o a.run", folder)


@pytest.mark.parametrize(
    ("name", "nth", "is_run"),
    [
        ("manifest.json", 0, False),
        ("posterior.png", 0, True),
        *(pytest.param(n, k, k > 0, marks=pytest.mark.slow) for n, k in [("checkpoint.npz", 0), ("posterior.npz", 1)]),
    ],
)
def test_a_killed_run_is_resumed_to_the_same_bytes(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, nth: int, is_run: bool
) -> None:
    kill_before(name, nth, tmp_path, monkeypatch)
    run = tmp_path / "a.run"
    assert (run / "manifest.json").exists() == is_run
    words = f"prf sample --resume a.run {STEPS}" if is_run else f"prf sample {RUN} {STEPS} -o a.run"
    assert call(words, tmp_path).code == 0
    assert [each for each in SAME if (run / each).read_bytes() != (whole / each).read_bytes()] == []
    assert json.loads((run / "manifest.json").read_text())["status"] == "finished"
    assert list(tmp_path.rglob(".*")) == []


ENDING = """
import os, {tool}.cli
calls, real = iter(range(10**6)), os.replace
def replace(source, target, **keywords):
    if str(target).startswith(os.getcwd()) and next(calls) == {nth}:
        os._exit(9)
    real(source, target, **keywords)
os.replace = replace
{tool}.cli.main({words!r})
"""
SEVERAL = {verb.title: verb for verb in VERBS if len(verb.writes) == 2 or verb.writes == ("out.sim/",)}
HEADS = {"out.yaml", "out.json", "out.sim/manifest.json"}
"""Files without which the others are no result."""


def outputs(folder: Path) -> dict[str, int]:
    """Return the files of the output with their inodes: the same number is the same file."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("[!.]*") if path.is_file()}
    return {name: path.stat().st_ino for name, path in found.items() if name.startswith("out")}


def killed_before(nth: int, verb: Verb, folder: Path) -> bool:
    """Run a verb in a process that ends before its n-th renaming; return whether it reached that."""
    tool, *words = verb.call.split()
    code = ENDING.format(nth=nth, tool=tool, words=[*words, "--force", "-q"])
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode in (0, 9), done.stderr
    return done.returncode == 9


@pytest.mark.slow
@pytest.mark.parametrize("verb", SEVERAL.values(), ids=SEVERAL)
def test_killed_between_two_files_of_a_result(verb: Verb, copied: Path) -> None:
    assert call(verb.call, copied, "-q").code == 0
    for nth in range(100):
        before = outputs(copied)
        if not killed_before(nth, verb, copied):
            break
        after = outputs(copied)
        is_new = set(after) == set(before) and not set(after.values()) & set(before.values())
        assert after == before or is_new or not HEADS & set(after), (nth, before, after)
        assert call(verb.call, copied, "--force", "-q").code == 0
        assert [path.name for path in copied.rglob(".*")] == []
        assert set(outputs(copied)) == set(before)
    assert nth >= 2, "the verb renames nothing"
