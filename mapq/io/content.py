"""What an input holds: its first bytes at once, the rest in the way that its reader asks for."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from prf.shell.files import STREAM, open_input
from prf.shell.gzipped import gunzip

GZIP_MAGIC = b"\x1f\x8b\x08"
"""With the only method that there is: two bytes alone begin one in 65,536 files of plain float32."""

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""

ACCEPTED = (
    "Read are PLY, PCD, LAS/LAZ, E57, PTX, XYZ/TXT/CSV, VTK, .npy, .npz, 3DTK .3d, KITTI .bin and ROS bags, "
    "also gzipped."
)
"""What is read, for messages."""

HEAD = 1 << 16
"""Bytes that tell a format."""


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
        The first `HEAD` bytes; none of a folder.

    Raises
    ------
    InputError
        If there is no such file, or it is gzipped and damaged.
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

    @contextmanager
    def stream(self) -> Iterator[BinaryIO]:
        """Give a seekable stream of the bytes, without taking a file into memory."""
        if self._data is not None:
            yield io.BytesIO(self._data)
            return
        with open_input(self.path) as stream:
            yield stream

    @contextmanager
    def file(self) -> Iterator[Path]:
        """Give a file with the bytes: the input itself, or a copy of what came compressed or by a pipe."""
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


def read_bytes(path: str) -> bytes:
    """Return the content of a file, decompressed if it is gzipped, without a byte order mark.

    Raises
    ------
    InputError
        If it is missing, a folder, or damaged.
    """
    return Content(path).data()
