"""Rows of numbers as text: XYZ, TXT, ASC, PTS and CSV, with or without a header; and the parser of all text formats.

Columns are separated by commas, semicolons, or blanks. A header names them, as the first row or as the last comment
above the rows (``//X Y Z Intensity``, as CloudCompare writes it); without one the first three columns are x, y, z and
the others `column_4`, `column_5` and so on. Every column is float64. A first line of one number is the count of points,
as in PTS.
"""

from __future__ import annotations

import io
import os
import re
import warnings
from typing import Any, NamedTuple

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import (
    Array,
    axes_of,
    columns_of,
    free_name,
    make_cloud,
    refuse_doubles,
    scalar_columns,
    warn_dropped,
)
from prf.shell.cli.files import open_output
from prf.shell.errors import InputError

TEXT_SUFFIXES = (".csv", ".xyz", ".txt", ".asc")
"""Of text that is written: rows separated by commas in the first, by blanks in the others."""
LARGEST_EXACT = 2**53
"""Whole numbers up to here are exact in double precision."""
CHUNK = 100_000
"""Rows that are converted to text at once."""
UNIT_TOL = 1e-3
"""By how much the length of rows of a rotation may differ from 1."""
_SLASHES = re.compile(rb"//[^\r\n]*")


def parse_rows(body: bytes, dtype: np.dtype[np.void], source: str, first_line: int = 1, **how: Any) -> Array:
    """Return the rows of a text as a structured array (n,); blank lines are skipped.

    Parameters
    ----------
    body : bytes
    dtype : structured dtype
        A field for each column that is read.
    source : str
        Name of the file, for messages.
    first_line : int
        Line of the file on which `body` begins.
    **how
        `delimiter`, `comments`, `usecols` and `max_rows` of :func:`numpy.loadtxt`.

    Raises
    ------
    InputError
        Names the first line that cannot be read.
    """
    how = {"comments": None, **how}
    try:
        return _load(body, dtype, how)
    except ValueError:
        lines = body.split(b"\n")
    begin, end = 0, len(lines)
    while end - begin > 1:  # halves: a line at a time would take minutes
        middle = (begin + end) // 2
        try:
            _load(b"\n".join(lines[begin:middle]), dtype, how)
            begin = middle
        except ValueError:
            end = middle
    text, width = lines[begin].decode("utf-8", "replace").strip()[:40], len(dtype.names or ())
    raise InputError(
        f"{source}:{first_line + begin}: {text!r} does not hold {width} numbers. Remove or correct this line; decimals "
        f"need a point."
    )


def _load(body: bytes, dtype: np.dtype[np.void], how: dict[str, Any]) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # "input contained no data": the callers count rows
        warnings.filterwarnings("error", ".*integer via a float", DeprecationWarning)  # it would read 256 as the byte 0
        try:
            return np.loadtxt(io.BytesIO(body), dtype, ndmin=1, **how)
        except (DeprecationWarning, IndexError, OverflowError) as error:
            raise ValueError(*error.args) from error


class _Head(NamedTuple):
    """What is above the rows: names, count of points, and where the first row is."""

    names: list[str] | None
    n_promised: int | None
    first_row: str
    line: int
    offset: int


def read_text(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a text of points."""
    data, source = content.data(), content.source
    head = _read_head(data, source)
    fields = split_row(head.first_row)
    names = _names(head, len(_trimmed(fields)), source)
    axes = axes_of(names, source)
    refuse_doubles(names, source)
    used = [column for column, name in enumerate(names) if name in axes or is_number(fields[column])]
    warn_dropped([name for column, name in enumerate(names) if column not in used], source)
    dtype = np.dtype([(names[column], np.float64) for column in used])
    how: dict[str, Any] = {"delimiter": _delimiter_of(head.first_row), "comments": "#"}
    if len(used) < len(fields):
        how["usecols"] = used
    rows = parse_rows(_SLASHES.sub(b"", data[head.offset :]), dtype, source, head.line, **how)
    if head.names is None and _are_poses(np.column_stack([rows[name] for name in rows.dtype.names or ()])):
        raise InputError(
            f"{source}: these are poses, not points. Give the scans too: mapq classify SCANS --poses FILE."
        )
    if head.n_promised not in (None, len(rows)):
        raise InputError(
            f"{source}: its first line promises {head.n_promised} points, {len(rows)} follow. Copy the file again, or "
            f"remove that line."
        )
    return make_cloud(columns_of(rows), source, options.unit or 1.0)


def write_text(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud as text, whole or not at all. OutputError if it cannot be written.

    Under a header, which in rows separated by blanks is the comment ``//x y z ...`` of CloudCompare. Numbers have all
    the digits that they need to be read back to the last bit; columns of whole numbers have no decimals.
    """
    columns: dict[str, Array] = {name: values for name, values in zip("xyz", cloud.world().T, strict=True)}
    for name, values in cloud.fields.items():
        for part, column in scalar_columns(name, values):
            columns[free_name(part.replace(",", "_").replace(";", "_"), columns)] = _shortest(column)
    separator = "," if os.fspath(path).lower().endswith(".csv") else " "
    with open_output(path) as stream:
        stream.write(("" if separator == "," else "//") + separator.join(columns) + "\n")
        for begin in range(0, len(cloud), CHUNK):
            cells = [values[begin : begin + CHUNK].astype(str).tolist() for values in columns.values()]
            stream.writelines(separator.join(row) + "\n" for row in zip(*cells, strict=True))


def _shortest(values: Array) -> Array:
    """Return numbers as integers where all of them are whole, as text is read as double precision throughout."""
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.kind != "f" or not (np.isfinite(values) & (np.abs(values) < LARGEST_EXACT)).all():
        return values
    whole = values.astype(np.int64)
    return whole if whole.astype(values.dtype).tobytes() == values.tobytes() else values


def _are_poses(values: Array) -> bool:
    """Return whether rows (n, w) end in unit quaternions, or are matrices 3 x 4 of rotations."""
    sizes = {7: values[:, 3:], 8: values[:, 4:], 12: values[:, :3]}.get(values.shape[1])
    return sizes is not None and bool((np.abs(np.linalg.norm(sizes, axis=1) - 1.0) < UNIT_TOL).all())


def _delimiter_of(row: str) -> str | None:
    """Return what separates the fields of a row: a semicolon, a comma, or None for blanks."""
    return ";" if ";" in row else "," if "," in row else None


def split_row(row: str) -> list[str]:
    """Return the fields of a row, without blanks around them."""
    return [part.strip() for part in row.split(_delimiter_of(row))]


def is_number(text: str) -> bool:
    """Return whether a field reads as a C number."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text.isascii()


def as_count(text: str) -> int | None:
    """Return a field as a whole number of at least 0, None if it is not one (or has more than 15 digits)."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 16 else None


def _read_head(data: bytes, source: str) -> _Head:
    names: list[str] | None = None
    commented: list[str] | None = None
    count: int | None = None
    line = offset = 0
    while offset < len(data):
        end = data.find(b"\n", offset) + 1 or len(data)
        text, line = data[offset:end].decode("utf-8", "replace").strip(), line + 1
        fields = split_row(text)
        if text.startswith(("#", "//")):
            commented = _header_names(text.lstrip("#/")) or commented
        elif count is None and names is None and len(fields) == 1 and as_count(text) is not None:
            count = as_count(text)
        elif text and names is None and not any(map(is_number, fields)):
            names = _header_names(text)
            if names is None:
                axes_of(fields, f"{source}:{line}")
        elif text:
            fits = commented is not None and len(commented) == len(_trimmed(fields))
            return _Head(names or (commented if fits else None), count, text, line, offset)
        offset = end
    raise InputError(f"{source}: no points. Give one point a row: x y z.")


def _header_names(text: str) -> list[str] | None:
    """Return the names in a header, None where it does not name the coordinates."""
    names = [name.strip("\"'") for name in _trimmed(split_row(text))]
    return names if {"x", "y", "z"} <= {name.lower() for name in names} else None


def _trimmed(fields: list[str]) -> list[str]:
    """Return fields without the empty one of a delimiter at the end of a row."""
    return fields[:-1] if fields and not fields[-1] else fields


def _names(head: _Head, width: int, source: str) -> list[str]:
    if head.names is None:
        return [*"xyz"[:width], *numbered_columns(width)]
    if len(head.names) != width:
        raise InputError(f"{source}:{head.line}: {width} columns under a header of {len(head.names)}. Correct either.")
    return [name or f"column_{number}" for number, name in enumerate(head.names, 1)]


def numbered_columns(width: int) -> list[str]:
    """Return names for the columns behind x, y, z of rows of this width."""
    return [f"column_{number}" for number in range(4, width + 1)]
