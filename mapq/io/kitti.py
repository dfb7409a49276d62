"""KITTI's .bin: float32, little endian, point after point, without a header that states the number of columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.io.fields import LARGEST_COORDINATE, Array
from prf.shell.errors import InputError

NAMES = ("x", "y", "z", "intensity")

WIDTHS = (3, 4, 5, 6)
"""Columns of such files: those of nuScenes have 5. More than 4 are recognised, not read."""

ENOUGH_POINTS = 200
"""With fewer, the spread of the columns is no evidence of how many there are."""

ALIKE, UNLIKE = 0.1, 0.5
"""Natural logarithms. Mixed-up columns have the same typical size within the first; coordinates and intensity, or
height and range, differ by more than the second."""


def read_kitti(data: bytes, source: str, n_columns: int) -> dict[str, Array]:
    """Return the columns x, y, z and, if there are four, intensity.

    The user gives the number of columns, since a file of 3 columns often divides into 4 as well; content that clearly
    contradicts it is refused.
    """
    other = 7 - n_columns
    if len(data) % (4 * n_columns):
        hint = f" It divides by {4 * other}: --bin-columns {other}?" if len(data) % (4 * other) == 0 else ""
        raise InputError(
            f"{source}: {len(data)} bytes are no whole number of points of {n_columns} float32 columns.{hint}"
        )
    values = np.frombuffer(data, "<f4")
    size = np.abs(values)
    if np.count_nonzero((size > LARGEST_COORDINATE) | ((size < 1e-20) & (size > 0))) > 0.01 * len(values):
        raise InputError(f"{source}: the content is no float32 coordinates, so this is no .bin of KITTI.")
    likely = _likely_columns(values, n_columns)
    if likely != n_columns:
        advice = f"Use --bin-columns {likely}" if likely <= len(NAMES) else "Save it as PLY or .npy"
        raise InputError(
            f"{source}: read with {n_columns} columns, all of them mix x, y and z; the file has {likely}. {advice}."
        )
    columns = values.reshape(-1, n_columns)
    return {name: columns[:, i] for i, name in enumerate(NAMES[:n_columns])}


def _likely_columns(values: NDArray[np.float32], n_columns: int) -> int:
    """Return the number of columns of which the content is clear evidence, else the given one."""
    if len(values) < 4 * ENOUGH_POINTS or _spread(values, n_columns) >= ALIKE:
        return n_columns
    fitting = (width for width in WIDTHS if width != n_columns and len(values) % width == 0)
    return next((width for width in fitting if _spread(values, width) > UNLIKE), n_columns)


def _spread(values: NDArray[np.float32], n_columns: int) -> float:
    """Return by how much the typical sizes of the columns differ, as a natural logarithm."""
    size = np.abs(values.reshape(-1, n_columns))
    typical = [float(np.median(column[np.isfinite(column)])) if np.isfinite(column).any() else 0.0 for column in size.T]
    if min(typical) <= 0.0:
        return float("inf") if max(typical) > 0.0 else 0.0
    return float(np.log(max(typical) / min(typical)))
