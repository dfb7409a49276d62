"""Killed between two files of one output: no file that makes a result stands beside others than its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.calls import call
from tests.fuzz.verbs import VERBS, Verb, make_samples
from tests.killed.child import ROOT

KILLED = 9
SEVERAL = [verb for verb in VERBS if len(verb.writes) == 2 or verb.writes in (("out.sim/",), ("out.city/",))]
ENDING = """
import os, {tool}.cli
calls, real = iter(range(10**6)), os.replace
def replace(source, target, **keywords):
    if str(target).startswith(os.getcwd()):
        if next(calls) == {nth}:
            os._exit({killed})
    real(source, target, **keywords)
os.replace = replace
{tool}.cli.main({words!r})
"""
HEADS = {"out.yaml", "out.json", "out.sim/manifest.json"}
"""Without which the other files are no result."""


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    make_samples(folder)
    return folder


def outputs(folder: Path) -> dict[str, int]:
    """Return the files of the output and when each was made: the same number is the same file."""
    found = {str(path.relative_to(folder)): path for path in folder.rglob("[!.]*") if path.is_file()}
    return {name: path.stat().st_ino for name, path in found.items() if name.startswith("out")}


def killed_before(nth: int, verb: Verb, folder: Path) -> bool:
    """Call a verb in a process of its own that ends before its n-th renaming; return whether it came so far."""
    tool, *words = verb.call.split()
    code = ENDING.format(nth=nth, killed=KILLED, tool=tool, words=[*words, "--force", "-q"])
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode in (0, KILLED), done.stderr
    return done.returncode == KILLED


@pytest.mark.slow
@pytest.mark.parametrize("verb", SEVERAL, ids=[verb.name for verb in SEVERAL])
def test_killed_between_two_files(verb: Verb, samples: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(samples, tmp_path / "work"))
    assert call(verb.call, folder).code == 0
    for nth in range(100):
        before = outputs(folder)
        if not killed_before(nth, verb, folder):
            break
        after = outputs(folder)
        has_head = bool(HEADS & set(after))
        is_old = after == before
        is_new = set(after) == set(before) and not set(after.values()) & set(before.values())
        assert is_old or is_new or not has_head, (nth, before, after)
        said = call(verb.call, folder, "--force")
        assert said.code == 0, said.err
        assert [path.name for path in folder.rglob(".*")] == []
        assert set(outputs(folder)) == set(before)
    assert nth >= 2, "this verb renames nothing"
