"""PTX: scans as grids of rows of text, each with the pose of its scanner."""

from __future__ import annotations

import logging

import numpy as np

from mapq.io.fields import Array, columns_of, joined_fields
from mapq.io.rows import Layout, parse_rows
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

HEADER_LINES = 10
"""Columns and rows of the grid, place and axes of the scanner, and the matrix that holds both again."""
WIDTHS = (3, 4, 7)
ROW = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("intensity", "f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]


def read_ptx(data: bytes, source: str) -> dict[str, Array]:
    """Return the points of all scans in the frame of the file, with `scan` where there are several.

    Cells of the grid without a return, written 0 0 0, are dropped.
    """
    parts = _scans(data, source, is_placed=True)
    return joined_fields(parts, [len(part["x"]) for part in parts], source)


def read_ptx_scan(data: bytes, source: str) -> dict[str, Array]:
    """Return the points of a file with one scan in the frame of its scanner, the matrix not applied."""
    parts = _scans(data, source, is_placed=False)
    if len(parts) > 1:
        raise InputError(f"{source}: {len(parts)} scans in one file, but one pose. Give a file for each scan.")
    return parts[0]


def _scans(data: bytes, source: str, is_placed: bool) -> list[dict[str, Array]]:
    """Return the fields of each scan, in the frame of the file or in its scanner's."""
    ends = np.flatnonzero(np.frombuffer(data.rstrip(), np.uint8) == ord("\n"))
    start = np.concatenate([[0], ends + 1, [len(data)]])
    parts: list[dict[str, Array]] = []
    line = n_empty = 0
    while line < len(start) - 1:
        n_cells, matrix = _head(data[start[line] : start[min(line + HEADER_LINES, len(start) - 1)]], line, source)
        line, last = line + HEADER_LINES, line + HEADER_LINES + n_cells
        if n_cells == 0 or last > len(start) - 1:
            raise InputError(
                f"{source}:{line}: this scan promises {n_cells} points, {len(start) - 1 - line} lines follow. Copy or "
                f"download the file again."
            )
        width = len(data[start[line] : start[line + 1]].split())
        if width not in WIDTHS:
            raise InputError(f"{source}:{line + 1}: {width} columns; PTX has x y z, intensity and perhaps r g b.")
        rows = parse_rows(data[start[line] : start[last]], Layout.of(np.dtype(ROW[:width])), source, line + 1)
        if len(rows) != n_cells:
            raise InputError(f"{source}:{line + 1}: blank lines among the {n_cells} points of a scan. Remove them.")
        line = last
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


def _head(text: bytes, line: int, source: str) -> tuple[int, Array]:
    """Return the number of cells of the scan whose header begins at a line, and its matrix (4, 4) for row vectors."""
    rows = [row.split() for row in text.splitlines()]
    try:
        n_cells = int(rows[0][0]) * int(rows[1][0])
        matrix = np.array(rows[6:HEADER_LINES], np.float64).reshape(4, 4)
    except (ValueError, IndexError):
        raise InputError(f"{source}:{line + 1}: not the header of a scan of PTX. Copy the file again.") from None
    if n_cells < 0 or not np.isfinite(matrix).all() or np.abs(matrix[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        raise InputError(
            f"{source}:{line + 7}: the last column of this matrix is not 0 0 0 1. PTX has the translation in its last "
            f"row; mend the header."
        )
    return n_cells, matrix
