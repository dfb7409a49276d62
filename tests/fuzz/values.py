"""Files in which one value in turn is exchanged for what has the right form, and no sense."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

BEYOND = (b"1" + b"0" * 400, b"-1" + b"0" * 400, b"1e999", b"1e308", b"9223372036854775808", b"NaN")
SMALL = (b"-1", b"0", b"0.5")
OTHERS = (b"null", b"true", b'"x"', b'"\\ud800"', b"[]", b"{}", b"[[1]]")
VALUES = (*BEYOND, *SMALL, *OTHERS)
TOKEN = re.compile(rb'(?<![\w.])-?\d[\d.eE+-]*(?![\w.])|"(?:[^"\\\n]|\\.)*"|\btrue\b|\bfalse\b|\bnull\b')
"""A number, a text in quotes or a word of JSON."""
MOST = 300
"""Places of a text that are tried, half of them its first ones."""

KINDS = ("f8", "i8", "u8", "U3", "S3", "?", "c16", "M8[s]")
NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1, -(2**31), 2**31 - 1, 2**63 - 1, 0, 1)


def exchanged(data: bytes) -> Iterator[bytes]:
    """Give variants of a text, of an archive of arrays, or of either in gzip; of other files none."""
    if data.startswith(b"PK"):
        yield from _of_archive(data)
    elif data.startswith(b"\x1f\x8b"):
        yield from (gzip.compress(each, 1) for each in exchanged(gzip.decompress(data)))
    elif data and all(byte >= ord(" ") or byte in b"\t\n\r" for byte in data[:2000]):
        yield from _of_text(data)


def _of_text(data: bytes) -> Iterator[bytes]:
    places = list(TOKEN.finditer(data))
    if len(places) > MOST:
        rest = np.linspace(MOST // 2, len(places) - 1, MOST // 2).astype(int)
        places = [*places[: MOST // 2], *(places[number] for number in rest)]
    for place in places:
        for value in VALUES:
            yield data[: place.start()] + value + data[place.end() :]


def _of_archive(data: bytes) -> Iterator[bytes]:
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    for name, array in arrays.items():
        yield _archive({other: each for other, each in arrays.items() if other != name})
        for variant in _of_array(array):
            yield _archive({**arrays, name: variant})


def _archive(arrays: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def _of_array(array: NDArray[Any]) -> Iterator[Any]:
    if array.dtype.kind == "U":
        yield from (np.str_(""), np.str_("\ud800"), np.float64(1.0), np.bytes_(b"x"), array[None])
        if str(array)[:1] in ("{", "["):
            yield from (np.str_(each.decode()) for each in _of_text(str(array).encode()))
        return
    yield from (array[None], array.ravel(), array[..., None], np.zeros((0,) * max(array.ndim, 1), array.dtype))
    if array.ndim:
        yield from (array[:0], array[:-1], np.concatenate([array, array]))
    with np.errstate(all="ignore"):
        yield from (array.astype(kind) for kind in KINDS)
        for number in NUMBERS:
            if array.dtype.kind == "f" or np.isfinite(number):
                yield from _with_number(array, number)


def _with_number(array: NDArray[Any], number: float) -> Iterator[NDArray[Any]]:
    """Give an array that holds a number everywhere, only first, and only last."""
    wanted = np.array(number).astype(array.dtype)
    for part in (slice(None), slice(1), slice(-1, None)):
        changed = array.copy()
        changed.reshape(-1)[part] = wanted
        yield changed
