"""PTX: scans as grids of rows of text, each with the pose of its scanner."""

from __future__ import annotations

import io
import logging
from itertools import islice

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import Array, columns_of, fields_of_scans, joined_fields, make_cloud
from mapq.io.text import parse_rows
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

HEADER_LINES = 10
"""Columns and rows of the grid, place and axes of the scanner, and the matrix that holds both again."""
WIDTHS = (3, 4, 7)
ROW = [("x", "f8"), ("y", "f8"), ("z", "f8"), ("intensity", "f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]


def read_ptx(content: Content, options: ReadOptions) -> PointCloud:
    """Return the points of all scans in the frame of the file; of several with `scan` and the way to the scanner.

    Cells of the grid without a return, written 0 0 0, are dropped.
    """
    parts, places = _scans(content.data(), content.source, is_placed=True)
    counts = [len(part["x"]) for part in parts]
    fields = joined_fields(parts, counts, content.source)
    fields |= fields_of_scans(np.column_stack([fields[axis] for axis in "xyz"]), places, counts, options.unit or 1.0)
    return make_cloud(fields, content.source, options.unit or 1.0)


def read_ptx_scan(content: Content) -> PointCloud:
    """Return the points of a file with one scan in the frame of its scanner, the matrix not applied."""
    parts, _ = _scans(content.data(), content.source, is_placed=False)
    if len(parts) > 1:
        raise InputError(f"{content.source}: {len(parts)} scans in one file, but one pose. Give a file for each scan.")
    return make_cloud(parts[0], content.source)


def ptx_pose(content: Content) -> Array:
    """Return the pose (4, 4) of the first scan of a file."""
    lines = list(islice(io.BytesIO(content.head), HEADER_LINES))
    return np.asarray(_head(lines, 1, content.source)[1].T)


def _scans(data: bytes, source: str, is_placed: bool) -> tuple[list[dict[str, Array]], Array]:
    """Return the fields of each scan, in the frame of the file or in its scanner's, and the scanners' places (k, 3)."""
    lines = iter(io.BytesIO(data.rstrip()))
    parts: list[dict[str, Array]] = []
    places, line = [], 1
    while head := list(islice(lines, HEADER_LINES)):
        n_cells, matrix = _head(head, line, source)
        line += HEADER_LINES
        cells = list(islice(lines, n_cells))
        width = len(cells[0].split()) if cells else 0
        if cells and width not in WIDTHS:
            raise InputError(f"{source}:{line}: {width} columns; PTX has x y z, intensity and perhaps r g b.")
        rows = parse_rows(b"".join(cells), np.dtype(ROW[: width or 3]), source, line)
        if len(rows) != n_cells or not n_cells:
            raise InputError(
                f"{source}:{line}: this scan promises {n_cells} points, {len(rows)} follow. Copy or download the file "
                f"again."
            )
        line += n_cells
        places.append(matrix[3, :3])
        parts.append(_placed(columns_of(rows), matrix if is_placed else np.eye(4)))
    n_empty = line - 1 - sum(HEADER_LINES + len(part["x"]) for part in parts)
    if n_empty:
        logger.info("%s: %d cells without a return are left out", source, n_empty)
    return parts, np.array(places)


def _placed(columns: dict[str, Array], matrix: Array) -> dict[str, Array]:
    """Return the cells with a return, moved by a matrix (4, 4) for row vectors."""
    local = np.column_stack([columns.pop(axis) for axis in "xyz"])
    seen = (local != 0.0).any(axis=1)
    points = local[seen] @ matrix[:3, :3] + matrix[3, :3]
    return dict(zip("xyz", points.T, strict=True)) | {name: values[seen] for name, values in columns.items()}


def _head(lines: list[bytes], line: int, source: str) -> tuple[int, Array]:
    """Return the number of cells of the scan whose header begins at a line, and its matrix (4, 4) for row vectors."""
    rows = [row.split() for row in lines]
    try:
        n_cells = int(rows[0][0]) * int(rows[1][0])
        matrix = np.array(rows[6:HEADER_LINES], np.float64).reshape(4, 4)
    except (ValueError, IndexError):
        raise InputError(f"{source}:{line}: not the header of a scan of PTX. Copy the file again.") from None
    if not np.abs(matrix[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() <= 1e-6:
        raise InputError(
            f"{source}:{line + 6}: the last column of this matrix is not 0 0 0 1. PTX has the translation in its last "
            f"row; correct the header."
        )
    return n_cells, matrix
