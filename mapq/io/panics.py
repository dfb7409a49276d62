"""Rust writes of a panic on standard error by itself, even of one that becomes an exception and then a line of ours."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any

STANDARD_ERROR = 2


class _Aside:
    """Where standard error goes meanwhile; any number of threads share it."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.n_users = 0
        self.has_failed = False
        self.kept: int | None = None
        self.file: IO[Any] | None = None

    def enter(self) -> None:
        with self.lock:
            self.n_users += 1
            if self.n_users > 1:
                return
            self.has_failed = False
            with suppress(OSError):  # closed, or no room for a file: what is written stays where it goes
                kept = os.dup(STANDARD_ERROR)
                try:
                    self.file = tempfile.TemporaryFile()  # noqa: SIM115 - closed by the last who leaves
                except OSError:
                    os.close(kept)
                    raise
                os.dup2(self.file.fileno(), STANDARD_ERROR)
                self.kept = kept

    def leave(self, has_failed: bool) -> None:
        with self.lock:
            self.n_users -= 1
            self.has_failed |= has_failed
            if self.n_users or self.kept is None or self.file is None:
                return
            os.dup2(self.kept, STANDARD_ERROR)
            if not self.has_failed:
                self.file.seek(0)
                with open(self.kept, "wb", closefd=False) as stream:
                    shutil.copyfileobj(self.file, stream)
            os.close(self.kept)
            self.file.close()
            self.kept = self.file = None


_ASIDE = _Aside()


@contextmanager
def panics_unheard() -> Iterator[None]:
    """Hold standard error back, and let go of what was written there only if no exception leaves the block.

    It is for short blocks of compiled code: what another thread writes meanwhile is late, or lost with the panic.
    """
    _ASIDE.enter()
    has_failed = True
    try:
        yield
        has_failed = False
    finally:
        _ASIDE.leave(has_failed)
