"""Points and paths as CSV: columns x and y in metres."""

from __future__ import annotations

import csv
import io
import math
import os

import numpy as np
from numpy.typing import NDArray

from prf.shell.cli.files import open_input
from prf.shell.errors import InputError

ADVICE = "Give a CSV with columns x and y."


def read_points(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Return the points (n, 2) in a CSV file, in the order of its rows.

    The header names the columns x and y, in any order and among others. Without a header the first two columns are
    taken. Blank lines and lines that start with # are skipped.
    """
    with open_input(path) as stream:
        try:
            text = stream.read().decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(f"{path}: not UTF-8 text. {ADVICE}") from error
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    rows = [(reader.line_num, row) for row in reader if any(map(str.strip, row)) and not row[0].startswith("#")]
    if not rows:
        raise InputError(f"{path}: no points in it. {ADVICE}")
    header = [field.strip().lower() for field in rows[0][1]]
    has_header = "x" in header and "y" in header
    columns = (header.index("x"), header.index("y")) if has_header else (0, 1)
    points = [_point(f"{path}:{line}", row, columns) for line, row in rows[int(has_header) :]]
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _point(place: str, row: list[str], columns: tuple[int, int]) -> tuple[float, float]:
    try:
        x, y = (float(row[column]) for column in columns)
    except (ValueError, IndexError) as error:
        raise InputError(f"{place}: no x and y in {','.join(row)!r}. Give two numbers in metres a row.") from error
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{place}: x and y must be finite, got {','.join(row)!r}.")
    return x, y
