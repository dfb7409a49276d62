"""Grey images as bytes: PGM, and PNG where pixels may be transparent."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
RGBA = 6
"""Colour type with transparency; map_server's reader loses that of grey images."""


def pgm_bytes(grey: NDArray[np.uint8]) -> bytes:
    """Return a binary PGM of (n_rows, n_columns) pixels, the top row first."""
    n_rows, n_columns = grey.shape
    return b"P5\n%d %d\n255\n" % (n_columns, n_rows) + np.ascontiguousarray(grey).tobytes()


def png_bytes(grey: NDArray[np.uint8], opaque: NDArray[np.bool_]) -> bytes:
    """Return a PNG of (n_rows, n_columns) pixels, the top row first, transparent where not `opaque`."""
    n_rows, n_columns = grey.shape
    pixels = np.stack([grey, grey, grey, np.where(opaque, 255, 0).astype(np.uint8)], axis=-1)
    filtered = np.zeros((n_rows, 1 + 4 * n_columns), np.uint8)  # each row begins with its filter: 0, none
    filtered[:, 1:] = pixels.reshape(n_rows, -1)
    header = struct.pack(">IIBBBBB", n_columns, n_rows, 8, RGBA, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 9)), (b"IEND", b""))
    return PNG_SIGNATURE + b"".join(_chunk(kind, content) for kind, content in chunks)


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
