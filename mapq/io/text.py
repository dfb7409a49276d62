"""XYZ, TXT, ASC, PTS and CSV: one point a row, with or without a header.

Columns are separated by commas, semicolons, or blanks. A header names them, as the first row or as the last comment
above the rows (``//X Y Z Intensity``, as CloudCompare writes it); without one the first three columns are x, y, z and
the others `column_4`, `column_5` and so on, since nothing says what they hold. Every column is float64. A first line of
one number is the count of points, as in PTS.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mapq.io.fields import Array, axes_of, columns_of, refuse_doubles, warn_dropped
from mapq.io.rows import Layout, as_count, is_number, parse_rows, split_row
from prf.shell.errors import InputError

MARKS = ("#", "//")
"""What begins a comment."""


class _Head(NamedTuple):
    """What stands above the rows: names, count of points, and where the first row is."""

    names: list[str] | None
    n_promised: int | None
    first_row: str
    line: int
    offset: int


def read_text(data: bytes, source: str) -> dict[str, Array]:
    """Return the columns of a text of points.

    Parameters
    ----------
    data : bytes
        The text, decompressed, without a byte order mark.
    source : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        Without rows or coordinates, and for a row that cannot be read.
    """
    head = _read_head(data, source)
    delimiter = delimiter_of(head.first_row)
    fields = split_row(head.first_row, delimiter)
    names = _names(head, fields, source)
    axes_of(names, source)
    taken = _taken(names, fields, source)
    dtype = np.dtype([(names[column], np.float64) for column in taken])
    layout = Layout(dtype, len(fields), tuple(taken), delimiter, comments=True)
    rows = parse_rows(data[head.offset :], layout, source, head.line)
    if head.n_promised is not None and head.n_promised != len(rows):
        raise InputError(
            f"{source}: its first line promises {head.n_promised} points, {len(rows)} follow. Copy the file again, or "
            f"remove that line."
        )
    return columns_of(rows)


def delimiter_of(row: str) -> str | None:
    """Return what separates the fields of a row: a semicolon, a comma, or None for blanks."""
    return ";" if ";" in row else "," if "," in row else None


def content_lines(data: bytes) -> Iterator[tuple[int, int, str]]:
    """Yield number (from 1), offset and stripped text of each line that is not blank."""
    number, start = 1, 0
    while start < len(data):
        end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        text = data[start:end].decode("utf-8", "replace").strip()
        if text:
            yield number, start, text
        number, start = number + 1, end + 1


def _read_head(data: bytes, source: str) -> _Head:
    names: list[str] | None = None
    said: list[str] | None = None
    count: int | None = None
    for line, offset, text in content_lines(data):
        if text.startswith(MARKS):
            said = _header_names(text.lstrip("#/")) or said
            continue
        fields = split_row(text, delimiter_of(text))
        number = as_count(fields[0]) if len(fields) == 1 and names is None else None
        if number is not None:
            _refuse_ptx(count, source)
            count = number
        elif names is None and not any(map(is_number, fields)):
            names = _header_names(text)
            if names is None:
                axes_of(fields, f"{source}:{line}")
        else:
            fits = said is not None and len(said) == len(_trim(fields))
            return _Head(names or (said if fits else None), count, text, line, offset)
    raise InputError(f"{source}: no points. Give one point a row: x y z.")


def _refuse_ptx(count: int | None, source: str) -> None:
    if count is not None:
        raise InputError(f"{source}: two lines of one number, as PTX has, and no matrix below. Copy the file again.")


def _header_names(text: str) -> list[str] | None:
    """Return the names in a header, None where it does not name the coordinates."""
    names = [name.strip("\"'") for name in _trim(split_row(text, delimiter_of(text)))]
    return names if {"x", "y", "z"} <= {name.lower() for name in names} else None


def _trim(fields: list[str]) -> list[str]:
    """Return fields without the empty one that a delimiter at the end of a row makes."""
    return fields[:-1] if fields and not fields[-1] else fields


def _names(head: _Head, fields: list[str], source: str) -> list[str]:
    width = len(_trim(fields))
    if head.names is None:
        return [*"xyz"[:width], *(f"column_{number}" for number in range(4, width + 1))]
    if len(head.names) != width:
        raise InputError(
            f"{source}:{head.line}: {width} columns under a header of {len(head.names)}. Mend the header or this line."
        )
    refuse_doubles(head.names, source)
    return [name or f"column_{number}" for number, name in enumerate(head.names, 1)]


def _taken(names: list[str], fields: list[str], source: str) -> list[int]:
    """Return the columns to take: coordinates, and the others whose first field is a number."""
    axes = axes_of(names, source)
    taken = [i for i, name in enumerate(names) if name in axes or is_number(fields[i])]
    warn_dropped([names[column] for column in sorted(set(range(len(names))) - set(taken))], source, kind="column")
    return taken
