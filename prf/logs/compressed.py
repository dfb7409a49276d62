"""Content of text files that may be gzipped, whatever their name."""

from __future__ import annotations

from prf.shell.gzipped import gunzip

GZIP_MAGIC = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""


def decompress(data: bytes, source: str) -> bytes:
    """Return `data`, decompressed if it is gzipped; `source` names it in the error if it is damaged or too large."""
    return gunzip(data, source) if data.startswith(GZIP_MAGIC) else data
