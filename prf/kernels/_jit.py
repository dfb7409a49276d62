"""The one decorator of every kernel, and the cache folder that can never hold stale machine code.

Numba's own cache looks at the file of the function it compiles, not at the functions that it calls: an edit in a
callee leaves callers running old code. The folder name therefore carries a digest of every kernel source, of the
flags below and of the versions that make the machine code, so that any edit starts an empty cache.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import llvmlite
import numba
import numpy as np

FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "cache": True}
"""``nogil`` lets chains run in threads; ``numpy`` errors make a division by zero give inf, not raise inside a chain.

``fastmath`` stays off: it would drop the nan and inf that the predicates rely on, and change results with the CPU.
"""

CORE_FLAGS: dict[str, Any] = {**FLAGS, "_nrt": False}
"""Flags of the sampler's kernels: ``_nrt`` off leaves reference counts out."""

KEPT_DIGESTS = 8
"""Caches of this many source states survive: enough to go back and forth between branches without compiling."""

PRUNE_AGE = 3600.0
"""Seconds without use before a surplus cache goes: a running process may still be writing a younger one."""

_Function = TypeVar("_Function", bound=Callable[..., Any])


def source_digest(folder: Path) -> str:
    """Return a digest of every kernel source in `folder`, the flags and the versions of the compilers."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    # Numba's index does not know about bounds checks: code compiled with them would stay in the cache, and without
    # them would be served when they are asked for.
    boundscheck = os.environ.get("NUMBA_BOUNDSCHECK", "")
    versions = (numba.__version__, llvmlite.__version__, np.__version__, platform.machine(), sys.version)
    digest.update(repr((sorted(CORE_FLAGS.items()), versions, boundscheck)).encode())
    return digest.hexdigest()[:16]


def cache_folder(digest: str) -> Path:
    """Return a writable folder for the machine code of the sources with this `digest`.

    In this order: ``PRF_CACHE_DIR``; the user's cache folder (XDG); a folder in the temporary directory that is the
    user's alone; a fresh one for this process only. Numba would otherwise fall back to ``__pycache__``, where an edit
    of a callee goes unseen.
    """
    for root in _candidate_roots():
        folder = root / digest
        if _is_writable(folder):
            _prune(root, folder)
            return folder
    fresh = Path(tempfile.mkdtemp(prefix="prf-kernels-"))
    atexit.register(shutil.rmtree, fresh, ignore_errors=True)
    return fresh / digest


def _candidate_roots() -> Iterator[Path]:
    chosen = os.environ.get("PRF_CACHE_DIR")
    if chosen:
        yield Path(chosen).expanduser().absolute()
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if os.path.isabs(base):
        yield Path(base) / "prf" / "kernels"
    shared = Path(tempfile.gettempdir()) / f"prf-kernels-{os.getuid()}"
    if _is_private(shared):
        yield shared


def _is_private(folder: Path) -> bool:
    """Make `folder` and return whether it is ours alone: what a cache holds is run, so nobody else may write it."""
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return False


def _is_writable(folder: Path) -> bool:
    """Make `folder`, mark it as used now, and return whether files can be written to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)
    except OSError:
        return False
    return True


def _prune(root: Path, current: Path) -> None:
    """Remove the caches of old source states, least recently used first; what cannot be removed stays."""
    with suppress(OSError):
        used = {path: path.stat().st_mtime for path in root.iterdir() if _is_digest(path.name) and path != current}
        for path in sorted(used, key=used.__getitem__, reverse=True)[KEPT_DIGESTS - 1 :]:
            if time.time() - used[path] > PRUNE_AGE:
                shutil.rmtree(path, ignore_errors=True)


def _is_digest(name: str) -> bool:
    """Return whether `name` is one that :func:`source_digest` gives: nothing else under the root is ours to remove."""
    return len(name) == 16 and all(character in "0123456789abcdef" for character in name)


CACHE_FOLDER = cache_folder(source_digest(Path(__file__).parent))


@contextmanager
def _own_cache() -> Iterator[None]:
    """Point numba to our cache while it decorates (it looks only then), and back for the other users of numba."""
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE_FOLDER)
    try:
        yield
    finally:
        config.CACHE_DIR = before


def jit(function: _Function) -> _Function:
    """Compile `function` in nopython mode with the project's flags, cached under :data:`CACHE_FOLDER`."""
    with _own_cache():
        compiled: _Function = numba.njit(**FLAGS)(function)
    return compiled


def core(function: _Function) -> _Function:
    """Compile a part of the sampler that only other kernels call: calling it from Python crashes the interpreter.

    Without reference counts (it must not allocate) a step is nine times faster: a chain is a tuple of some eighty
    arrays, each of which would be counted at every call. Without an entry from Python and a cache file of its own
    a cold start takes half the time; the cache file of the :func:`core_entry` that calls it holds its code.
    """
    flags = {**CORE_FLAGS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "cache": False}
    compiled: _Function = numba.njit(**flags)(function)
    return compiled


def core_entry(function: _Function) -> _Function:
    """Compile a part of the sampler that Python calls: as :func:`core`, with an entry and cached."""
    with _own_cache():
        compiled: _Function = numba.njit(**CORE_FLAGS)(function)
    return compiled


def is_compiled(kernel: str) -> bool:
    """Return whether the cache holds machine code of the entry `kernel` (``module.function``) for these sources."""
    return any(CACHE_FOLDER.rglob(f"{kernel}-*.nbi"))
