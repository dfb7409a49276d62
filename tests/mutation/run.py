"""One mistake a process: a fork imports the altered source instead of the file, and its guard runs there."""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import importlib.util
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import CodeType
from typing import NamedTuple

from tests.mutation.guards import Guard

ROOT = Path(__file__).resolve().parents[2]
MEMORY = 6 * 2**30
"""Bytes that an altered source may ask for."""
FIXED, FACTOR = 10.0, 5.0
"""CPU seconds, and times its time on the intact source, that a guard may take before it counts as hung."""
SURVIVED, KILLED = 0, 1


class Outcome(NamedTuple):
    """How a guard ended.

    Attributes
    ----------
    survived : bool
        Whether it found nothing wrong.
    seconds : float
        CPU time.
    said : str
        What it printed.
    """

    survived: bool
    seconds: float
    said: str


class _Altered(importlib.machinery.SourceFileLoader):
    """Loads a module from a text instead of its file."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self.source = source

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.source, self.path, "exec", dont_inherit=True)


class _Finder(importlib.abc.MetaPathFinder):
    """Gives one module its altered source."""

    def __init__(self, module: str, source: str) -> None:
        self.module, self.source = module, source

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != self.module:
            return None
        loader = _Altered(fullname, str(path_of(fullname)), self.source)
        return importlib.util.spec_from_file_location(fullname, loader.path, loader=loader)


def path_of(module: str) -> Path:
    """Return the file of a module, without importing it."""
    return ROOT.joinpath(*module.split(".")).with_suffix(".py")


def warm() -> None:
    """Import the libraries that guards use, so that a fork need not; nothing of the project, no plugins of pytest."""
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    import hypothesis.strategies  # noqa: F401
    import matplotlib.path  # noqa: F401
    import maxflow  # noqa: F401
    import numba  # noqa: F401
    import pytest  # noqa: F401
    import scipy.integrate
    import scipy.optimize
    import scipy.sparse.csgraph
    import scipy.spatial
    import scipy.stats  # noqa: F401
    import shapely  # noqa: F401


def run_guard(guard: Guard, source: str, limit: float, states: Path) -> Outcome:
    """Run a guard on a source in a fork of this process, which must not have imported the project.

    Parameters
    ----------
    guard : Guard
    source : str
        Of its module.
    limit : float
        CPU seconds after which it is killed.
    states : Path
        File of the chains that ratios are checked on.
    """

    def child() -> int:
        sys.meta_path.insert(0, _Finder(guard.module, source))
        if guard.moves:
            from tests.mutation.ratios import draw_faults, faults, load_states

            worlds = load_states(states)
            found = faults(worlds, guard.moves)
            found += [fault for move in guard.moves for fault in draw_faults(worlds, move)]
            if found:
                print(found[0])
                return KILLED
        return KILLED if guard.tests and _pytest(guard.tests) else SURVIVED

    return in_fork(child, limit)


def in_fork(work: Callable[[], int], limit: float) -> Outcome:
    """Return what `work` comes to in a process of its own."""
    reader, writer = os.pipe()
    sys.stdout.flush()
    before = _children_seconds()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os._exit(_alone(work, limit, writer))
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        said = stream.read().decode(errors="replace")
    _, status = os.waitpid(child, 0)
    return Outcome(status == 0, _children_seconds() - before, said)


def _alone(work: Callable[[], int], limit: float, writer: int) -> int:
    """Run `work` with its output in a pipe and its means limited; whatever it raises is a mistake found."""
    os.dup2(writer, 1)
    os.dup2(writer, 2)
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 3))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    signal.alarm(int(60.0 + 20.0 * limit))
    try:
        code = work()
    except BaseException:
        traceback.print_exc()
        code = KILLED
    sys.stdout.flush()
    return code


def _pytest(arguments: tuple[str, ...]) -> int:
    import pytest

    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow", "--tb=line", "--rootdir", str(ROOT)]
    return int(pytest.main([*options, *(str(ROOT / one) for one in arguments)]))


def _children_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
