"""PTX: scans as grids of rows of text, each with the pose of its scanner."""

from __future__ import annotations

import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.io.fields import Array, columns_of
from mapq.io.joined import joined_fields
from mapq.io.rows import Layout, as_count, is_number, parse_rows
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

HEADER_LINES = 10
"""Columns and rows of the grid, place and axes of the scanner, and the matrix in which both stand again."""
WIDTHS = (3, 4, 7)
NAMES = ("x", "y", "z", "intensity", "red", "green", "blue")
TYPES = ("f8", "f8", "f8", "f8", "u1", "u1", "u1")


class _Lines(NamedTuple):
    """A text by its lines: `start` has one entry more than there are lines."""

    data: bytes
    start: NDArray[np.int64]
    source: str

    def where(self, line: int) -> str:
        """Return the place of a line, from 0, for messages."""
        return f"{self.source}:{line + 1}"

    def words(self, line: int) -> list[str]:
        """Return the words of a line."""
        return self.data[self.start[line] : self.start[line + 1]].decode("latin-1").split()


def read_ptx(data: bytes, source: str) -> dict[str, Array]:
    """Return the points of all scans of a PTX file in its frame, with `scan` where there are several.

    Cells of the grid without a return, written 0 0 0, are dropped.

    Raises
    ------
    InputError
        For a header that cannot be read, a row that cannot, and a scan that is cut off.
    """
    parts = _scans(data, source, is_placed=True)
    return joined_fields(parts, [len(part["x"]) for part in parts], source)


def read_ptx_scan(data: bytes, source: str) -> dict[str, Array]:
    """Return the points of a PTX file with one scan in the frame of its scanner, the matrix not applied.

    Raises
    ------
    InputError
        As :func:`read_ptx`, and if there are several scans.
    """
    parts = _scans(data, source, is_placed=False)
    if len(parts) > 1:
        raise InputError(f"{source}: {len(parts)} scans in one file, but one pose. Give a file for each scan.")
    return parts[0]


def _scans(data: bytes, source: str, is_placed: bool) -> list[dict[str, Array]]:
    """Return the fields of each scan, in the frame of the file or in its scanner's."""
    ends = np.flatnonzero(np.frombuffer(data.rstrip(), np.uint8) == ord("\n"))
    lines = _Lines(data, np.concatenate([[0], ends + 1, [len(data)]]), source)
    parts: list[dict[str, Array]] = []
    line = n_empty = 0
    while line < len(lines.start) - 1:
        n_cells, matrix = _head(lines, line)
        line += HEADER_LINES
        rows = _rows(lines, line, n_cells)
        line += n_cells
        columns = columns_of(rows)
        local = np.column_stack([columns.pop(axis) for axis in "xyz"])
        seen = (local != 0.0).any(axis=1)
        n_empty += n_cells - int(np.count_nonzero(seen))
        points = local[seen] @ matrix[:3, :3] + matrix[3, :3] if is_placed else local[seen]
        places = {axis: points[:, number] for number, axis in enumerate("xyz")}
        parts.append(places | {name: values[seen] for name, values in columns.items()})
    if n_empty:
        logger.info("%s: %d cells without a return are left out", source, n_empty)
    return parts


def _head(lines: _Lines, line: int) -> tuple[int, NDArray[np.float64]]:
    """Return how many cells the scan has whose header begins at a line, and its matrix (4, 4) for row vectors."""
    if line + HEADER_LINES > len(lines.start) - 1:
        raise InputError(f"{lines.where(line)}: the header of a scan of PTX is cut off. Copy the file again.")
    sizes = [as_count(" ".join(lines.words(line + number))) for number in range(2)]
    if sizes[0] is None or sizes[1] is None:
        raise InputError(f"{lines.where(line)}: not the columns and rows of a scan of PTX. Copy the file again.")
    rows = [lines.words(line + 6 + number) for number in range(4)]
    if not all(len(row) == 4 and all(map(is_number, row)) for row in rows):
        raise InputError(f"{lines.where(line + 6)}: not the four rows of a matrix. Copy the file again.")
    matrix = np.array(rows, np.float64)
    if not np.isfinite(matrix).all() or np.abs(matrix[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        raise InputError(
            f"{lines.where(line + 6)}: the last column of this matrix is not 0 0 0 1. PTX has the translation in its "
            f"last row; mend the header."
        )
    return sizes[0] * sizes[1], matrix


def _rows(lines: _Lines, line: int, n_cells: int) -> Array:
    """Return the cells of a scan as a structured array (n,)."""
    last = line + n_cells
    if last > len(lines.start) - 1:
        raise InputError(
            f"{lines.source}: cut off: the scan at line {line - HEADER_LINES + 1} promises {n_cells} points, "
            f"{len(lines.start) - 1 - line} lines follow. Copy or download the file again."
        )
    if n_cells == 0:
        raise InputError(f"{lines.where(line - HEADER_LINES)}: a scan without points. Remove it.")
    width = len(lines.words(line))
    if width not in WIDTHS:
        raise InputError(f"{lines.where(line)}: {width} columns; a row of PTX is x y z, intensity and perhaps r g b.")
    layout = Layout(np.dtype(list(zip(NAMES[:width], TYPES[:width], strict=True))), width, tuple(range(width)))
    rows = parse_rows(lines.data[lines.start[line] : lines.start[last]], layout, lines.source, line + 1)
    if len(rows) != n_cells:
        raise InputError(f"{lines.where(line)}: blank lines among the {n_cells} points of a scan. Remove them.")
    return rows
