"""Columns of numbers out of a CSV table with a header, for every reader of such tables.

Blank lines and lines that begin with ``#`` are passed over; names of columns are read without case, blanks and quotes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from prf.logs.numbers import MEND, as_floats, is_number, show
from prf.logs.readings import FloatArray, IntArray
from prf.shell.errors import InputError
from prf.window import LARGEST_COORDINATE

BLOCK = 65536
"""Rows parsed at a time, so that the text fields of a long table are never all in memory."""

PIECE = 1 << 20
"""Bytes cut into lines at a time, about."""


class Header(NamedTuple):
    """The header of a table.

    Attributes
    ----------
    places : dict of str to int
        Known columns, and where each stands.
    width : int
        Number of columns, unknown ones included.
    """

    places: dict[str, int]
    width: int


class Rows(NamedTuple):
    """The rows under the header.

    Attributes
    ----------
    source : str
        Name of the table, for messages.
    line : (n,) int64
        Number of each row in the file.
    columns : dict of str to (n,) float64
    """

    source: str
    line: IntArray
    columns: dict[str, FloatArray]


class Domain(NamedTuple):
    """The values that a column may hold, and the words for them."""

    words: str
    low: float
    high: float

    def holds(self, values: FloatArray) -> np.ndarray:
        """Return which values (n,) lie in the domain; nan never does."""
        return (values >= self.low) & (values <= self.high)


PLACE = Domain("metres, finite", -LARGEST_COORDINATE, LARGEST_COORDINATE)
"""Of a coordinate."""


def content_lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and text of every line that counts; the lines of a long table are never all in memory."""
    number = start = 0
    while start < len(data):
        # Cut behind a line feed: no line ends in two of the pieces, whichever way it ends.
        end = data.find(b"\n", start + PIECE) + 1 or len(data)
        for line in data[start:end].splitlines():
            number += 1
            if _counts(line):
                yield number, line
        start = end


def column_names(line: bytes) -> list[str]:
    """Return the names in a header line, lower case, without blanks and quotes."""
    return [name.strip(" \t\"'").lower() for name in line.decode("utf-8", "replace").split(",")]


def read_header(line: bytes, where: str, required: Sequence[str], optional: Sequence[str], advice: str) -> Header:
    """Return which columns a header has.

    Parameters
    ----------
    line : bytes
    where : str
        ``file:line``, for the message.
    required, optional : sequence of str
        Names of columns; others are left alone.
    advice : str
        What to do about a header that lacks a column.

    Raises
    ------
    InputError
        If a required column is missing, or a known one is there twice.
    """
    names = column_names(line)
    known = [name for name in names if name in (*required, *optional)]
    doubled = sorted({name for name in known if known.count(name) > 1})
    missing = [name for name in required if name not in known]
    if missing or doubled:
        what = f"no column {', '.join(missing)}" if missing else f"column {', '.join(doubled)} twice"
        raise InputError(f"{where}: the header has {what}. {advice}")
    return Header({name: names.index(name) for name in known}, len(names))


def read_rows(lines: Iterable[tuple[int, bytes]], header: Header, source: str, empty: Mapping[str, bytes]) -> Rows:
    """Return the numbers in the known columns.

    Parameters
    ----------
    lines : iterable of (int, bytes)
        Numbers and texts of the lines under the header; there may be none.
    header : Header
    source : str
    empty : mapping of str to bytes
        What an empty field of a column stands for; in every other column it is an error.

    Raises
    ------
    InputError
        If a row has another number of fields than the header, or a field is no number.
    """
    rest = iter(lines)
    numbers = [np.zeros(0, np.int64)]
    parts: dict[str, list[FloatArray]] = {name: [np.zeros(0)] for name in header.places}
    while block := list(islice(rest, BLOCK)):
        number = np.array([n for n, _ in block], dtype=np.int64)
        numbers.append(number)
        fields = _fields(block, header, source)
        for name, place in header.places.items():
            texts = fields[place :: header.width]
            if name in empty:
                texts = [text if text and not text.isspace() else empty[name] for text in texts]
            parts[name].append(_column(texts, name, number, source))
    return Rows(source, np.concatenate(numbers), {name: np.concatenate(blocks) for name, blocks in parts.items()})


def _fields(block: Sequence[tuple[int, bytes]], header: Header, source: str) -> list[bytes]:
    """Return the fields of rows, row by row, refused if a row has another number of them than the header."""
    commas = np.array([line.count(b",") for _, line in block])
    wrong = np.flatnonzero(commas != header.width - 1)
    if len(wrong):
        at, has = block[wrong[0]][0], commas[wrong[0]] + 1
        raise InputError(f"{source}:{at}: row of {has} fields under a header of {header.width}. {MEND}")
    return b",".join(line for _, line in block).split(b",")


def refuse_value(rows: Rows, name: str, good: np.ndarray, words: str) -> None:
    """Raise InputError for the first value of a column that is not `good` (n,); `words` say what it must be."""
    bad = np.flatnonzero(~good)
    if len(bad):
        at = f"{rows.source}:{rows.line[bad[0]]}"
        raise InputError(f"{at}: {name} is {rows.columns[name][bad[0]]:g}, but must be {words}. {MEND}")


def _counts(line: bytes) -> bool:
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(b"#")


def _column(fields: list[bytes], name: str, number: IntArray, source: str) -> FloatArray:
    values = as_floats(fields)
    if values is None:
        bad = next(i for i, text in enumerate(fields) if not is_number(text))
        raise InputError(f"{source}:{number[bad]}: {name} is {show(fields[bad].strip())}, not a number. {MEND}")
    return values
