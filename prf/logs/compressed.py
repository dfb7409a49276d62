"""Content of text files that may be gzipped, whatever their name."""

from __future__ import annotations

import gzip
import zlib

from prf.shell.errors import InputError

GZIP_MAGIC = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""


def decompress(data: bytes, source: str) -> bytes:
    """Return `data`, decompressed if it is gzipped; `source` names it in the error if it is damaged."""
    if not data.startswith(GZIP_MAGIC):
        return data
    try:
        return gzip.decompress(data)
    except EOFError:
        raise InputError(f"{source}: the gzip file is cut off at its end. Copy or download it again.") from None
    except (OSError, zlib.error):
        raise InputError(f"{source}: the gzip file is damaged. Copy or download it again.") from None
