"""Points and paths as CSV: columns x and y in metres."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError
from prf.shell.files import open_input


def read_points(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Return the points in a CSV file, in the order of its rows.

    The header names the columns x and y, in any order and among others. Without a header the first two columns are
    taken. Blank lines and lines that start with # are skipped.
    """
    with open_input(path) as stream:
        text = _decode(path, stream.read())
    rows = _rows(text)
    first = next(rows, None)
    if first is None:
        raise InputError(f"{path}: no points in it. Give a CSV with columns x and y.")
    columns = _columns(first[1])
    points = [] if columns else [_point(path, *first, (0, 1))]
    points += [_point(path, line, row, columns or (0, 1)) for line, row in rows]
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _decode(path: str | os.PathLike[str], data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text. Give a CSV with columns x and y.") from error


def _rows(text: str) -> Iterator[tuple[int, Sequence[str]]]:
    """Yield line number and fields of every row that holds something."""
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    for row in reader:
        if any(field.strip() for field in row) and not row[0].startswith("#"):
            yield reader.line_num, row


def _columns(header: Sequence[str]) -> tuple[int, int] | None:
    """Return the places of x and y in a header, None if the row is no header."""
    names = [field.strip().lower() for field in header]
    return (names.index("x"), names.index("y")) if "x" in names and "y" in names else None


def _point(
    path: str | os.PathLike[str], line: int, row: Sequence[str], columns: tuple[int, int]
) -> tuple[float, float]:
    try:
        x, y = (float(row[column]) for column in columns)
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{path}:{line}: no x and y in {','.join(row)!r}. Give two numbers in metres a row."
        ) from error
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{path}:{line}: x and y must be finite, got {','.join(row)!r}.")
    return x, y
