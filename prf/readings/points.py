"""Point observations: CSV with the columns x, y and value, one observation a row (docs/sensor-models.md)."""

from __future__ import annotations

import csv
import io
import math
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.window import Window
from prf.readings.text import BYTE_ORDER_MARK, FloatArray, IntArray, content_lines, decompress, read_rows
from prf.shell.cli.files import STREAM, open_input
from prf.shell.errors import InputError

REQUIRED = ("x", "y", "value")


class PointTable(NamedTuple):
    """Point observations as a file has them.

    Attributes
    ----------
    xy : (n, 2) float64
        Places, metres.
    value : (n,) float64
    line : (n,) int64
        Line of each in the file.
    source : str
        Name of the file, for messages.
    """

    xy: FloatArray
    value: FloatArray
    line: IntArray
    source: str

    def inside(self, window: Window) -> PointTable:
        """Return the observations inside a window, off its border."""
        return self.select(window.contains(self.xy, strictly=True))

    def select(self, mask: NDArray[np.bool_] | IntArray) -> PointTable:
        """Return the observations that a boolean mask or an index array picks."""
        return self._replace(xy=self.xy[mask], value=self.value[mask], line=self.line[mask])

    def refuse_other_than_colours(self) -> None:
        """Raise InputError for the first value that is neither 0 nor 1."""
        bad = np.flatnonzero((self.value != 0.0) & (self.value != 1.0))
        if len(bad):
            raise InputError(
                f"{self.source}:{self.line[bad[0]]}: value is {self.value[bad[0]]:g}, but binary observations are 0 "
                f'(white) or 1 (black). Correct it, or set kind = "gaussian" in [points].'
            )


def describe_points(table: PointTable) -> dict[str, Any]:
    """Return what is in a file of point observations, and what `prf sample` takes them for by default."""
    x, y = table.xy.T
    value = table.value
    return {
        "source": table.source,
        "n_points": len(value),
        "n_places": len(np.unique(table.xy, axis=0)),
        "extent": (float(x.min()), float(y.min()), float(x.max()), float(y.max())),  # of the places, metres
        "kind": "binary" if np.isin(value, (0.0, 1.0)).all() else "gaussian",
        "lowest": float(value.min()),
        "highest": float(value.max()),
        "mean": float(value.mean()),
    }


def read_point_data(path: str | os.PathLike[str]) -> PointTable:
    """Read point observations; gzipped or not, ``-`` is standard input.

    `path`: a CSV file whose header names the columns x, y and value, in any order and among others. Blank lines and
    lines that begin with ``#`` are skipped.
    """
    source = "standard input" if os.fspath(path) == STREAM else os.fspath(path)
    with open_input(path) as stream:
        data = decompress(stream.read(), source).removeprefix(BYTE_ORDER_MARK)
    if next(content_lines(data), None) is None:
        raise InputError(f"{source}: the file is empty. Give a CSV table with the columns x,y,value.")
    rows = read_rows(data, source, REQUIRED, (), {}, "Name the columns x,y,value.")
    return PointTable(np.column_stack((rows.columns["x"], rows.columns["y"])), rows.columns["value"], rows.line, source)


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
