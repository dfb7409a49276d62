"""A cache folder for machine code that can never serve stale code, and what is shown while it is filled.

Numba's own cache looks at the file of the function it compiles, not at the functions that it calls: an edit in a
callee leaves callers running old code. The folder name therefore carries a digest of every kernel source, of the
flags and of the versions that make the machine code, so that any edit starts an empty cache. Both tools' kernel
packages take their folder from here; of the shell only what they take imports numba.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import logging
import multiprocessing
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import event

from prf.shell.cli.console import Report, progress, report_nothing, settings

KEPT_DIGESTS = 8
"""Caches of this many source states survive: enough to go back and forth between branches without compiling."""

PRUNE_AGE = 3600.0
"""Seconds without use before a surplus cache is removed: a running process may still be writing a younger one."""


COLLECTED_AFTER = 100_000
"""Objects between two searches for garbage while numba compiles, which makes many that live: a tenth of its time."""

logger = logging.getLogger(__name__)


class KernelCache(event.Listener):
    """The cache folder of one package of kernels, for its `sources` and the `flags` of the compiler.

    `tool` names the folder, and the variable that overrides it: ``prf`` gives ``PRF_CACHE_DIR``. It also listens to
    numba, reports how many functions of ``<tool>.kernels`` this process has compiled, and shows it while it lasts.
    """

    def __init__(self, tool: str, sources: Path, flags: Mapping[str, Any]) -> None:
        self.folder = cache_folder(tool, source_digest(sources, flags))
        self.compiled: set[str] = set()
        self._tool = tool
        self._open: list[str] = []
        self._shown = ExitStack()
        self._report: Report = report_nothing
        register: Any = event.register
        register("numba:compile", self)

    @contextmanager
    def own(self) -> Iterator[None]:
        """Point numba to this folder while it decorates (it looks only then), and back for others that use numba."""
        config: Any = numba.config
        before = config.CACHE_DIR
        config.CACHE_DIR = str(self.folder)
        try:
            yield
        finally:
            config.CACHE_DIR = before

    def on_start(self, event: Any) -> None:
        """Show the count while a kernel that Python calls is compiled, with all that it calls."""
        name = self._name(event)
        if not name:
            return
        self._open.append(name)
        if len(self._open) == 1 and multiprocessing.parent_process() is None:
            if not self.compiled:
                needs = f"what {settings.command or 'this call'} needs for such an input"
                logger.info(f"compiling {needs}, once on this machine; {self._tool} warm compiles all ahead ...")
            self._shown.callback(gc.set_threshold, *gc.get_threshold())
            gc.set_threshold(COLLECTED_AFTER)
            self._report = self._shown.enter_context(progress(None, "compiling"))

    def on_end(self, event: Any) -> None:
        """Count it."""
        if self._name(event):
            self.compiled.add(self._open.pop())
            n = len(self.compiled)
            self._report(n, kernels=n)
            if not self._open:
                self._shown.close()
                self._report = report_nothing

    def _name(self, event: Any) -> str:
        """Return the full name of the function that an event is about, empty if it is not of these kernels."""
        function = event.data["dispatcher"].py_func
        if not function.__module__.startswith(f"{self._tool}.kernels."):
            return ""
        return f"{function.__module__}.{function.__qualname__}"


def source_digest(folder: Path, flags: Mapping[str, Any]) -> str:
    """Return a digest of every kernel source in `folder`, the `flags` and the versions of the compilers."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    # Numba's index does not know about bounds checks: code compiled with them would stay in the cache, and without
    # them would be served when they are asked for.
    boundscheck = os.environ.get("NUMBA_BOUNDSCHECK", "")
    versions = (numba.__version__, llvmlite.__version__, np.__version__, platform.machine(), sys.version)
    digest.update(repr((sorted(flags.items()), versions, boundscheck)).encode())
    return digest.hexdigest()[:16]


def cache_folder(tool: str, digest: str) -> Path:
    """Return a writable folder for the machine code of the sources with this `digest`.

    In this order: ``<TOOL>_CACHE_DIR``; the user's cache folder (XDG); a folder in the temporary directory that is the
    user's alone; a fresh one for this process only. Numba would otherwise fall back to ``__pycache__``, where an edit
    of a callee goes unseen.
    """
    for root in _candidate_roots(tool):
        folder = root / digest
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            os.utime(folder)
            _prune(root, folder)
            return folder
    fresh = Path(tempfile.mkdtemp(prefix=f"{tool}-kernels-"))
    atexit.register(shutil.rmtree, fresh, ignore_errors=True)
    return fresh / digest


def _candidate_roots(tool: str) -> Iterator[Path]:
    chosen = os.environ.get(f"{tool.upper()}_CACHE_DIR")
    if chosen:
        yield Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if os.path.isabs(base):
        yield Path(base) / tool / "kernels"
    shared = Path(tempfile.gettempdir()) / f"{tool}-kernels-{os.getuid()}"
    if _is_private(shared):
        yield shared


def _is_private(folder: Path) -> bool:
    """Make `folder` and return whether it is ours alone: what a cache holds is run, so nobody else may write it."""
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return False


def _prune(root: Path, current: Path) -> None:
    """Remove the caches of old source states, least recently used first; what cannot be removed stays."""
    with suppress(OSError):
        others = [path for path in root.iterdir() if re.fullmatch("[0-9a-f]{16}", path.name) and path != current]
        used = {path: path.stat().st_mtime for path in others}
        for path in sorted(used, key=used.__getitem__, reverse=True)[KEPT_DIGESTS - 1 :]:
            if time.time() - used[path] > PRUNE_AGE:
                shutil.rmtree(path, ignore_errors=True)
