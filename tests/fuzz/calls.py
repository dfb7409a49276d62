"""Calls of the tools: in this process, or in a child that gives up the rights of root."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

from prf.shell.run import run_app

ROOT = Path(__file__).resolve().parents[2]
NOBODY = 65534


class Said(NamedTuple):
    """What a call came to."""

    code: int
    out: str
    err: str


def call(line: str, folder: Path, *more: str) -> Said:
    """Call a tool in `folder`, as :func:`call_words`."""
    return call_words([*line.split(), *more], folder)


def call_words(words: list[str], folder: Path) -> Said:
    """Call a tool with `folder` for working directory; it says what its program would, with the same exit code."""
    with contextlib.chdir(folder):
        return _call_here(words)


def _call_here(words: list[str]) -> Said:
    tool, *args = words
    app = importlib.import_module(f"{tool}.cli").app
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_app(app, tool, [*args, "-q"])
    if not out.closed:
        out.flush()
    return Said(code, out.buffer.getvalue().decode() if not out.closed else "", err.getvalue())


def call_as_nobody(line: str, folder: Path, path: Path, mode: int) -> Said:
    """Call a tool in `folder` without the rights of root, while `path` has the permissions `mode`.

    A child does it: this process could not change back to a folder that only root may enter.
    """
    words = [sys.executable, "-m", "tests.fuzz.calls", line, str(folder), str(path), str(mode)]
    before = path.stat().st_mode
    try:
        done = subprocess.run(
            words, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
        )
    finally:
        path.chmod(before)
    assert done.returncode == 0, done.stderr
    return Said(*json.loads(done.stdout))


def _as_nobody(line: str, folder: str, path: str, mode: str) -> Said:
    """Call twice in `folder`: as root, which imports all that is needed, and then, on a clean place, as nobody."""
    os.chdir(folder)
    _call_here(line.split())
    for made in Path().glob("out*"):
        shutil.rmtree(made) if made.is_dir() else made.unlink()
    os.chmod(path, int(mode))
    if os.geteuid() == 0:
        os.seteuid(NOBODY)
    return _call_here(line.split())


if __name__ == "__main__":
    print(json.dumps(_as_nobody(*sys.argv[1:])))
