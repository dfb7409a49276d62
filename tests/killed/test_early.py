"""Ctrl-C and SIGTERM while a verb starts or compiles: nothing is said or left, and the exit code is 130 or 143."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from prf.shell import litter
from tests.fuzz.verbs import VERBS, Verb, make_samples
from tests.killed.child import ROOT

SIGNALS = (signal.SIGINT, signal.SIGTERM)
OF_EACH_VERB = list({tuple(verb.call.split()[:2]): verb for verb in VERBS}.values())
AT_IMPORT = """
import os, runpy, signal, sys
class Interrupting:
    count = 0
    def find_spec(self, *_):
        self.count += signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        if self.count == {nth}:
            os.kill(os.getpid(), {number})
sys.meta_path.insert(0, counting := Interrupting())
sys.argv = ["{tool}", *{words!r}]
try:
    runpy.run_module("{tool}", run_name="__main__", alter_sys=True)
finally:
    print(counting.count, file=sys.stderr)
"""
IN_A_CALLBACK = """
import ctypes, os, signal
from prf.shell import files, signals
code = "def notify(): os.kill(os.getpid(), {number})"
names = dict(os=os, __name__="{package}.binding")
exec(code, names)
with signals.ending_the_tool(), files.atomic_write("a.txt"):
    ctypes.CFUNCTYPE(None)(names["notify"])()
"""
COMPILING = """
import os, sys, numba
from llvmlite.binding.executionengine import ExecutionEngine
from prf.shell.run import run_app

class Verb:
    def main(self, *_, **__):
        find = ExecutionEngine._find_module_ptr
        def interrupted(self, pointer):
            os.kill(os.getpid(), {number})
            return find(self, pointer)
        ExecutionEngine._find_module_ptr = interrupted
        numba.njit(lambda x: 2.0 * x)(1.0)
        print("nothing came of it")

sys.exit(run_app(Verb(), "prf", []))
"""
FINISHING = ("sample", "anneal")
"""Verbs that end in good order: asked to after their last step they are done."""
FIRST = ("/__init__.py", "/__main__.py", "/early.py")
"""The files that Python reads before signals are taken."""
MOMENTS = (0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3)


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    make_samples(folder)
    return folder


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def clear(folder: Path) -> None:
    for path in folder.glob("out*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def interrupted(verb: Verb, folder: Path, nth: int, number: int) -> tuple[int, str]:
    """Start a verb that gets a signal at its n-th import once it takes signals; return exit code and standard error."""
    tool, *words = verb.call.split()
    code = AT_IMPORT.format(nth=nth, number=int(number), tool=tool, words=[*words, "-q"])
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment(), capture_output=True, text=True)
    assert done.stdout == "" or done.returncode == 0
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("verb", OF_EACH_VERB, ids=lambda verb: verb.name)
def test_at_an_import(verb: Verb, samples: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(samples, tmp_path / "work"))
    code, err = interrupted(verb, folder, -1, signal.SIGINT)
    assert code == 0, err
    n_imports = int(err.split()[-1])
    clear(folder)
    before = sorted(folder.rglob("*"))
    for turn, share in enumerate((0.0, 0.1, 0.3, 0.6, 0.95)):
        nth = 1 + int(share * (n_imports - 1))
        code, err = interrupted(verb, folder, nth, SIGNALS[turn % 2])
        if code == 0 and verb.name.split()[1] in FINISHING:
            clear(folder)
            continue
        assert (code, err) == (128 + SIGNALS[turn % 2], ""), nth
        assert sorted(folder.rglob("*")) == before, nth


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS)
def test_in_the_first_moments(number: signal.Signals, tmp_path: Path) -> None:
    """Before the first line of ours Python ends as it does: by the signal, or with a traceback of its own."""
    for tool in ("prf", "mapq"):
        for seconds in MOMENTS:
            process = subprocess.Popen(
                [sys.executable, "-m", tool, "inspect", "absent"],
                cwd=tmp_path,
                env=environment(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            time.sleep(seconds)
            process.send_signal(number)
            err = process.communicate()[1]
            lines = [line for line in err.splitlines() if f"/{tool}/" in line or "/prf/" in line]
            of_ours = [line for line in lines if not any(name in line for name in FIRST)]
            is_pythons = not of_ours and process.returncode in (-number, 1, 130)
            is_missing = process.returncode == 3
            assert is_pythons or is_missing or (process.returncode, err) == (128 + number, ""), (seconds, err)


@pytest.mark.parametrize(("package", "code"), [("llvmlite", 143), ("unknown", 0)])
def test_in_a_callback_that_loses_exceptions(package: str, code: int, tmp_path: Path) -> None:
    """The other package shows that the exception is lost indeed: Python prints it and goes on."""
    script = IN_A_CALLBACK.format(number=int(signal.SIGTERM), package=package)
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment(), capture_output=True)
    assert done.returncode == code
    assert (done.stderr == b"") == (code != 0)
    assert sorted(path.name for path in tmp_path.iterdir()) == (["a.txt"] if code == 0 else [])


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS)
def test_while_numba_compiles(number: signal.Signals, tmp_path: Path) -> None:
    """Machine code is handed over by a callback; an exception there left half of it, and exit code 0 or 70."""
    script = COMPILING.format(number=int(number))
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=environment(), capture_output=True)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, b"", b"")


def test_what_is_marked_goes(tmp_path: Path) -> None:
    for name in ("made", "full", "made.work"):
        (tmp_path / name).mkdir()
    for name in ("made/file", "full/file", "made.work/file", "kept"):
        (tmp_path / name).write_text("")
    marked = ("made", "full", "made.work", "made/file", "kept", "absent")
    for name in marked:
        litter.mark(tmp_path / name)
    litter.unmark(tmp_path / "kept")
    litter.sweep()
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")) == ["full", "full/file", "kept"]
    for name in marked:
        litter.unmark(tmp_path / name)


def test_a_signal_that_is_ignored_stays_so() -> None:
    code = "from prf.shell.early import end_quietly; end_quietly(); import signal; print(signal.getsignal(2))"
    command = [sys.executable, "-c", f"import signal; signal.signal(2, signal.SIG_IGN); {code}"]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True)
    assert done.stdout.strip() in ("1", "Handlers.SIG_IGN"), done.stderr
