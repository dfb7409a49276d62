"""What must not outlive the process: files half written, locks, work folders.

Their makers remove them. A process that a signal ends in the middle of an import or of a compiler, where no exception
passes, sweeps them itself.
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress

WORK = ".work"
"""End of the name of a work folder."""

_marked: dict[str, int] = {}
"""Path to the process that made it: a forked one must not sweep what is another's."""


def mark(path: str | os.PathLike[str]) -> None:
    """Have a file or folder removed if the process ends at once."""
    _marked[os.fspath(path)] = os.getpid()


def unmark(path: str | os.PathLike[str]) -> None:
    """Forget a file or folder that is removed, or in its place."""
    _marked.pop(os.fspath(path), None)


def sweep() -> None:
    """Remove what this process has marked, the last first; a folder that is no work folder only if it is empty."""
    for path, process in reversed(_marked.items()):
        if process != os.getpid():
            continue
        if path.endswith(WORK):
            shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            (os.rmdir if os.path.isdir(path) else os.unlink)(path)
