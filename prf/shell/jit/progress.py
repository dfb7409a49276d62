"""Progress of compiling: how many kernels a job needs, said once, and a bar that counts them while they are made."""

from __future__ import annotations

import gc
import logging
import multiprocessing
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core import event

from prf.shell.cli.progress import Report, progress

logger = logging.getLogger(__name__)

COLLECTED_AFTER = 100_000
"""Objects between two searches for garbage while numba compiles, which makes many that live: a tenth of its time."""


class CompileProgress(event.Listener):
    """Counts the functions of ``<tool>.kernels`` that numba compiles in this process, and shows it."""

    def __init__(self, tool: str, cached: Callable[[], set[str]]) -> None:
        self.done: set[str] = set()
        self._tool = tool
        self._cached = cached
        self._open: list[str] = []
        self._shown = ExitStack()
        self._reporter: Report
        self._total = 0

    def on_start(self, event: Any) -> None:
        """Show the count while a kernel that Python calls is compiled, with all that it calls."""
        name = self._name(event)
        if not name:
            return
        self._open.append(name)
        if len(self._open) == 1 and multiprocessing.parent_process() is None:
            self._total = max(len(self.done | self._needed()), 1)
            if not self.done:
                logger.info(f"compiling {self._total} kernels, once ({self._tool} warm does it ahead) ...")
            self._shown.callback(gc.set_threshold, *gc.get_threshold())
            gc.set_threshold(COLLECTED_AFTER)
            self._reporter = self._shown.enter_context(progress(self._total, "compiling"))

    def on_end(self, event: Any) -> None:
        """Count it."""
        if self._name(event):
            self.done.add(self._open.pop())
            n = len(self.done)
            if self._total:
                self._reporter(min(n, self._total), kernels=f"{n}/{self._total}")
            if not self._open:
                self._shown.close()

    def _name(self, event: Any) -> str:
        function = event.data["dispatcher"].py_func
        return full_name(function) if function.__module__.startswith(f"{self._tool}.kernels.") else ""

    def _needed(self) -> set[str]:
        """Return the kernels not in the cache that the modules loaded so far call, directly or not."""
        prefix, cached = f"{self._tool}.kernels.", self._cached()
        found: set[str] = set()
        queue: list[Any] = []
        for name, module in list(sys.modules.items()):
            if name.startswith(f"{self._tool}.") and not name.startswith(prefix):
                queue += [each for each in vars(module).values() if is_kernel(each) and cache_name(each) not in cached]
        while queue:
            kernel = queue.pop()
            if full_name(kernel.py_func) not in found:
                found.add(full_name(kernel.py_func))
                queue += called_by(kernel.py_func)
        return {name for name in found if name.startswith(prefix)}


def called_by(function: Any) -> list[Any]:
    """Return the kernels that a function names, also as ``module.kernel``."""
    names = function.__code__.co_names
    known = [function.__globals__[name] for name in names if name in function.__globals__]
    known += [vars(each).get(name) for each in known if isinstance(each, ModuleType) for name in names]
    return [each for each in known if is_kernel(each)]


def is_kernel(value: Any) -> bool:
    """Return whether a value is a compiled function."""
    return hasattr(value, "py_func") and hasattr(value, "nopython_signatures")


def full_name(function: Any) -> str:
    """Return the name of a function with its module."""
    return f"{function.__module__}.{function.__qualname__}"


def cache_name(kernel: Any) -> str:
    """Return how numba's cache names a kernel: ``file.function``."""
    return f"{Path(kernel.py_func.__code__.co_filename).stem}.{kernel.py_func.__qualname__}"
