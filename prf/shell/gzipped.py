"""Gzipped content, and how much of it may be unpacked: a small file can promise more than any memory holds."""

from __future__ import annotations

import gzip
import io
import os
import zlib

from prf.shell.errors import InputError

PIECE = 1 << 22
"""Bytes that are unpacked at once."""

SHARE = 0.5
"""Of this machine's memory that unpacked content may take."""


def gunzip(data: bytes, source: str) -> bytes:
    """Return what a gzipped file holds.

    Raises
    ------
    InputError
        If it is damaged, cut off, or holds more than :func:`most_unpacked`; `source` names it.
    """
    whole = io.BytesIO()
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
            while piece := stream.read(PIECE):
                whole.write(piece)
                refuse_large(whole.tell(), source)
    except EOFError:
        raise InputError(f"{source}: the gzip file is cut off at its end. Copy or download it again.") from None
    except (OSError, zlib.error):
        raise InputError(f"{source}: the gzip file is damaged. Copy or download it again.") from None
    return whole.getvalue()


def most_unpacked() -> int:
    """Return the bytes that are unpacked at most."""
    return int(SHARE * os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))


def refuse_large(size: int, source: str) -> None:
    """Raise InputError if `size` bytes are more than may be unpacked."""
    most = most_unpacked()
    if size > most:
        raise InputError(
            f"{source}: unpacked it is larger than {most / 1e9:.3g} GB, {SHARE:.0%} of this machine's memory. Use a "
            f"machine with more, or cut the file into pieces."
        )
