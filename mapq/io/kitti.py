"""KITTI's .bin: float32, little endian, point after point, without a header that states the number of columns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE, make_cloud
from prf.shell.errors import InputError

NAMES = ("x", "y", "z", "intensity")

WIDTHS = (3, 4, 5, 6)
"""Columns of such files: those of nuScenes have 5. More than 4 are recognised, not read."""

ENOUGH_POINTS = 200
"""With fewer, the spread of the columns does not show how many there are."""

ALIKE, UNLIKE = 0.1, 0.5
"""Natural logarithms. Mixed-up columns have the same typical size within the first; coordinates and intensity, or
height and range, differ by more than the second."""


def read_kitti(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of columns x, y, z and, if there are four, intensity.

    The user gives the number of columns, since a file of 3 columns often divides into 4 as well; content that clearly
    contradicts it is refused.
    """
    data, source, width = content.data(), content.source, options.bin_columns
    other = 7 - width
    if len(data) % (4 * width):
        hint = f" It divides by {4 * other}: --set cloud.bin_columns={other}?" if len(data) % (4 * other) == 0 else ""
        raise InputError(
            f"{source}: {len(data)} bytes, expected a multiple of {4 * width} ({width} float32 columns a point).{hint}"
        )
    values = np.frombuffer(data, "<f4")
    size = np.abs(values)
    if np.count_nonzero((size > LARGEST_COORDINATE) | ((size < 1e-20) & (size > 0))) > 0.01 * len(values):
        raise InputError(f"{source}: expected float32 coordinates, as in a .bin of KITTI.")
    likely = _likely_columns(size, width)
    if likely != width:
        advice = f"Use --set cloud.bin_columns={likely}" if likely <= len(NAMES) else "Save it as PLY or .npy"
        raise InputError(
            f"{source}: read with {width} columns, all of them mix x, y and z; the file has {likely}. {advice}."
        )
    return make_cloud(dict(zip(NAMES, values.reshape(-1, width).T, strict=False)), source, options.unit or 1.0)


def _likely_columns(size: NDArray[np.float32], n_columns: int) -> int:
    """Return the number of columns of which the sizes of all values are clear evidence, else the given one."""
    if len(size) < 4 * ENOUGH_POINTS or _spread(size, n_columns) >= ALIKE:
        return n_columns
    fitting = (width for width in WIDTHS if width != n_columns and len(size) % width == 0)
    return next((width for width in fitting if _spread(size, width) > UNLIKE), n_columns)


def _spread(size: NDArray[np.float32], n_columns: int) -> float:
    """Return by how much the typical sizes of the columns differ, as a natural logarithm."""
    columns = (column[np.isfinite(column)] for column in size.reshape(-1, n_columns).T)
    typical = [float(np.median(column)) if len(column) else 0.0 for column in columns]
    least, most = min(typical), max(typical)
    if least > 0.0:
        return math.log(most / least)
    return float("inf") if most > 0.0 else 0.0
