"""Bytes of an input whose storage may fail: a broken disk or a lost connection is told with the name of the input."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO

from prf.shell.errors import InputError, system_reason

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

AT_ONCE = 1 << 17
"""Bytes that are asked of the system at a time."""


def buffered(stream: BinaryIO, path: str | os.PathLike[str]) -> io.BufferedReader:
    """Return a stream of the bytes of `stream`, whose errors name `path`.

    Raises
    ------
    InputError
        When read, if the system refuses.
    """
    return io.BufferedReader(_Told(stream, path), AT_ONCE)


class _Told(io.RawIOBase):
    """Passes on what another stream reads, and turns the system's refusal into an error of the user's input."""

    def __init__(self, stream: BinaryIO, path: str | os.PathLike[str]) -> None:
        self._stream, self._path = stream, path

    def readinto(self, buffer: WriteableBuffer) -> int | None:
        with self._telling():
            return self._stream.readinto(buffer)  # type: ignore[attr-defined, no-any-return]

    def readall(self) -> bytes:
        with self._telling():
            return self._stream.read()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        return self._stream.tell()

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return self._stream.seekable()

    def fileno(self) -> int:
        return self._stream.fileno()

    def isatty(self) -> bool:
        return self._stream.isatty()

    @property
    def name(self) -> Any:
        """Of the stream behind."""
        return self._stream.name

    @contextmanager
    def _telling(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"{os.fspath(self._path)}: cannot be read ({system_reason(error)}).") from error
