"""Lines and tables of text logs; whatever cannot be read in one is reported by file and line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from prf.model.sensors import LARGEST_COORDINATE
from prf.shell.cli.files import gunzip
from prf.shell.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Parsed = TypeVar("Parsed")

GZIP_MAGIC = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"  # UTF-8's, which spreadsheets put before a CSV header
MAX_TIME = 1e20  # seconds. Beyond any clock, nanoseconds taken for seconds included, and safe to subtract
MEND = "Remove or correct this line and run again."
DOMAINS = {
    "x": (-LARGEST_COORDINATE, LARGEST_COORDINATE, "metres, finite"),
    "y": (-LARGEST_COORDINATE, LARGEST_COORDINATE, "metres, finite"),
    "theta": (-LARGEST_COORDINATE, LARGEST_COORDINATE, "radians, finite"),
    "range": (0.0, np.inf, "a distance of at least 0, or empty or inf for no return"),
    "cone": (0.0, 2 * np.pi, "an angle from 0 to 2 pi"),
    "t": (-MAX_TIME, MAX_TIME, "seconds, finite, or empty"),
    "scan": (0.0, 2.0**53 - 1, "a whole number from 0"),
    "value": (-1e100, 1e100, "a finite number"),
}
"""Lowest and highest value of a column, and words for both."""


def decompress(data: bytes, source: str) -> bytes:
    """Return `data`, decompressed if it is gzipped."""
    return gunzip(data, source) if data.startswith(GZIP_MAGIC) else data


def check_domains(source: str, line: IntArray, columns: Mapping[str, FloatArray], nan: Sequence[str] = ("t",)) -> None:
    """Raise InputError for the first value outside `DOMAINS`; the columns `nan` may hold nan."""
    for name, values in columns.items():
        low, high, words = DOMAINS[name]
        bad = ~((values >= low) & (values <= high))
        if name in nan:
            bad &= ~np.isnan(values)
        if bad.any():
            first = int(bad.argmax())
            raise InputError(f"{source}:{line[first]}: {name} is {values[first]:g}, but must be {words}. {MEND}")


def floats(fields: Sequence[bytes]) -> FloatArray:
    """Return text fields as float64 (ValueError if one is not a number)."""
    return np.array(fields, dtype=np.float64)


def expect_length(fields: Sequence[bytes], allowed: Sequence[int], announced: str) -> None:
    """Raise ValueError if a line has not as many fields as what it announces makes."""
    if len(fields) not in allowed:
        raise ValueError(f"announces {announced}, which makes {allowed[0]} fields, but has {len(fields)}")


def parse_lines(
    parse: Callable[[int, list[bytes]], Parsed], lines: Iterable[tuple[int, bytes]], source: str
) -> list[Parsed]:
    """Return ``parse(number, fields)`` of numbered lines; its ValueError or IndexError becomes an InputError."""
    found = []
    for number, line in lines:
        try:
            found.append(parse(number, line.split()))
        except (ValueError, IndexError) as error:
            reason = "ends too early" if isinstance(error, IndexError) else str(error)
            raise InputError(f"{source}:{number}: damaged line: {reason}. {MEND}") from error
    return found


def content_lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and text of every line that is neither blank nor a comment (``#``)."""
    for number, line in enumerate(data.splitlines(), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith(b"#"):
            yield number, line


def column_names(line: bytes) -> list[str]:
    """Return the names in a header line, lower case, without blanks and quotes."""
    return [name.strip(" \t\"'").lower() for name in line.decode("utf-8", "replace").split(",")]


class Rows(NamedTuple):
    """The known columns of a CSV table."""

    line: IntArray  # (n,) number of each row in the file
    columns: dict[str, FloatArray]
    n_unknown: int  # further columns


def read_rows(
    data: bytes, source: str, required: Sequence[str], optional: Sequence[str], empty: Mapping[str, float], advice: str
) -> Rows:
    """Return the known columns of a CSV table with a header, within their `DOMAINS`.

    `required`, `optional`: names of columns, read without case; others are counted. `empty`: what an empty field of a
    column means; in every other column it is an error. `advice`: what to do about a header that lacks a column.
    """
    lines = content_lines(data)
    first, header = next(lines, (1, b""))
    names = column_names(header)
    known = [name for name in (*required, *optional) if name in names]
    if missing := [name for name in required if name not in names]:
        raise InputError(f"{source}:{first}: the header has no column {', '.join(missing)}. {advice}")
    top = next(lines, None)
    if top is None:
        raise InputError(f"{source}: table without a row below its header.")
    numbers: list[int] = []

    def rows() -> Iterator[str]:
        for number, line in chain([top], lines):
            numbers.append(number)
            if line.count(b",") != len(names) - 1:
                raise ValueError(f"row of {line.count(b',') + 1} fields under a header of {len(names)}")
            yield line.decode("latin-1")

    places = [names.index(name) for name in known]
    fills: dict[int | str, Any] = {names.index(n): _filled(value) for n, value in empty.items() if n in known}
    try:
        table = np.loadtxt(rows(), delimiter=",", comments=None, ndmin=2, usecols=places, converters=fills)
    except ValueError as error:
        reason = str(error).partition(" at row ")[0]
        raise InputError(f"{source}:{numbers[-1]}: {reason}. {MEND}") from error
    columns = dict(zip(known, np.ascontiguousarray(table.T), strict=True))
    found = Rows(np.array(numbers), columns, len(names) - len(known))
    check_domains(source, found.line, found.columns)
    return found


def _filled(value: float) -> Callable[[str], float]:
    """Return a converter of text fields that takes an empty one for `value`."""
    return lambda text: float(text) if text.strip() else value
