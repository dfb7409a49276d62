"""XYZ, TXT, ASC, PTS and CSV: one point a row, with or without a header.

Columns are separated by commas, semicolons, or blanks. A header names them, as the first row or as the last comment
above the rows (``//X Y Z Intensity``, as CloudCompare writes it); without one the first three columns are x, y, z and
the others `column_4`, `column_5` and so on. Every column is float64. A first line of one number is the count of points,
as in PTS.
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
    """What is above the rows: names, count of points, and where the first row is."""

    names: list[str] | None
    n_promised: int | None
    first_row: str
    line: int
    offset: int


def read_text(data: bytes, source: str) -> dict[str, Array]:
    """Return the columns of a text of points; InputError names the line that cannot be read."""
    head = _read_head(data, source)
    delimiter = _delimiter_of(head.first_row)
    fields = split_row(head.first_row, delimiter)
    names = _names(head, fields, source)
    axes = axes_of(names, source)
    used = [column for column, name in enumerate(names) if name in axes or is_number(fields[column])]
    dropped = sorted(set(range(len(names))) - set(used))
    warn_dropped([names[column] for column in dropped], source, kind="column")
    dtype = np.dtype([(names[column], np.float64) for column in used])
    layout = Layout(dtype, len(fields), tuple(used), delimiter, comments=True)
    rows = parse_rows(data[head.offset :], layout, source, head.line)
    if head.n_promised not in (None, len(rows)):
        raise InputError(
            f"{source}: its first line promises {head.n_promised} points, {len(rows)} follow. Copy the file again, or "
            f"remove that line."
        )
    return columns_of(rows)


def _delimiter_of(row: str) -> str | None:
    """Return what separates the fields of a row: a semicolon, a comma, or None for blanks."""
    return ";" if ";" in row else "," if "," in row else None


def _lines(data: bytes) -> Iterator[tuple[int, int, str]]:
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
    commented: list[str] | None = None
    count: int | None = None
    for line, offset, text in _lines(data):
        if text.startswith(MARKS):
            commented = _header_names(text.lstrip("#/")) or commented
            continue
        fields = split_row(text, _delimiter_of(text))
        if count is None and names is None and len(fields) == 1 and as_count(fields[0]) is not None:
            count = as_count(fields[0])
        elif names is None and not any(map(is_number, fields)):
            names = _header_names(text)
            if names is None:
                axes_of(fields, f"{source}:{line}")
        else:
            fits = commented is not None and len(commented) == len(_trimmed(fields))
            return _Head(names or (commented if fits else None), count, text, line, offset)
    raise InputError(f"{source}: no points. Give one point a row: x y z.")


def _header_names(text: str) -> list[str] | None:
    """Return the names in a header, None where it does not name the coordinates."""
    names = [name.strip("\"'") for name in _trimmed(split_row(text, _delimiter_of(text)))]
    return names if {"x", "y", "z"} <= {name.lower() for name in names} else None


def _trimmed(fields: list[str]) -> list[str]:
    """Return fields without the empty one of a delimiter at the end of a row."""
    return fields[:-1] if fields and not fields[-1] else fields


def _names(head: _Head, fields: list[str], source: str) -> list[str]:
    width = len(_trimmed(fields))
    if head.names is None:
        return [*"xyz"[:width], *(f"column_{number}" for number in range(4, width + 1))]
    if len(head.names) != width:
        raise InputError(
            f"{source}:{head.line}: {width} columns under a header of {len(head.names)}. Mend the header or this line."
        )
    refuse_doubles(head.names, source)
    return [name or f"column_{number}" for number, name in enumerate(head.names, 1)]
