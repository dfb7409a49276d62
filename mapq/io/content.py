"""What an input holds: its first bytes at once, the rest in the way that its reader needs."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from prf.shell.cli.files import STREAM, gunzip, open_input
from prf.shell.errors import InputError, PrfError

GZIP_MAGIC = b"\x1f\x8b\x08"
"""With its only method: two bytes alone begin one in 65,536 files of plain float32."""

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""

ACCEPTED = (
    "Read are PLY, PCD, LAS/LAZ, E57, PTX, XYZ/TXT/CSV, .npy, .npz, 3DTK .3d, KITTI .bin and ROS bags, also gzipped."
)

HEAD = 1 << 16
"""Bytes that identify a format."""


class Content:
    """An input, decompressed if it is gzipped, without a byte order mark.

    Parameters
    ----------
    path : str
        A file or a folder; ``-`` is standard input.

    Attributes
    ----------
    path, source, name : str
        As given, for messages, and the name of the file: empty for standard input.
    is_folder : bool
    head : bytes
        The first `HEAD` bytes; empty for a folder.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.source = "standard input" if path == STREAM else path
        self.name = "" if path == STREAM else Path(path).name
        self.is_folder = path != STREAM and Path(path).is_dir()
        self._data: bytes | None = None
        self.head = b"" if self.is_folder else self._first_bytes()

    def data(self) -> bytes:
        """Return all bytes."""
        if self._data is None:
            with open_input(self.path) as stream:
                self._data = stream.read().removeprefix(BYTE_ORDER_MARK)
        return self._data

    def text(self) -> str:
        """Return the content as UTF-8 text; invalid bytes are replaced."""
        return self.data().decode("utf-8", "replace")

    @contextmanager
    def stream(self) -> Iterator[BinaryIO]:
        """Give a seekable stream of the bytes, without reading a file into memory."""
        if self._data is not None:
            yield io.BytesIO(self._data)
            return
        with open_input(self.path) as stream:
            yield stream

    @contextmanager
    def file(self) -> Iterator[Path]:
        """Give a file with the bytes: the input itself, or a copy of compressed or piped bytes."""
        if self._data is None:
            yield Path(self.path)
            return
        with TemporaryDirectory() as folder:
            copy = Path(folder) / "copy"
            copy.write_bytes(self._data)
            yield copy

    def _first_bytes(self) -> bytes:
        """Return the head; what can be read only once, or must be decompressed, is read whole."""
        with open_input(self.path) as stream:
            head = stream.read(HEAD)
            is_zipped = head.startswith(GZIP_MAGIC)
            if is_zipped or not stream.seekable() or self.path == STREAM:
                data = head + stream.read()
                self._data = (gunzip(data, self.source) if is_zipped else data).removeprefix(BYTE_ORDER_MARK)
                return self._data[:HEAD]
        return head.removeprefix(BYTE_ORDER_MARK)


def suffix_of(path: str) -> str:
    """Return the suffix that identifies a file's kind, such as ``.ply`` of ``maps/A.PLY.gz``."""
    return Path(re.sub(r"\.gz$", "", path.lower())).suffix


@contextmanager
def damage_in_one_line(source: str) -> Iterator[None]:
    """Turn whatever a reader or its library raises for a damaged file into an InputError that names the file."""
    try:
        yield
    except BaseException as error:
        is_panic = type(error).__module__.startswith("pyo3_runtime")  # of lazrs, which is not an Exception
        if isinstance(error, PrfError) or not (is_panic or isinstance(error, Exception)):
            raise
        words = " ".join(str(error).split())[:120] or type(error).__name__
        words = f"{words} is missing" if isinstance(error, KeyError) else words
        where = f"{source}:{error.lineno}" if isinstance(error, json.JSONDecodeError) else source
        raise InputError(f"{where}: damaged or cut off ({words}). Copy, download or export it again.") from error
