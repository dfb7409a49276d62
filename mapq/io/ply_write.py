"""Writing a cloud as PLY, as CloudCompare, MeshLab and Open3D open it."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping

import numpy as np
from plyfile import PlyData, PlyElement  # type: ignore[import-untyped]

from mapq.cloud import PointCloud
from mapq.io.fields import Array
from mapq.io.free_names import free_name, scalar_columns
from prf.shell.files import open_output

logger = logging.getLogger(__name__)

LARGEST_EXACT = 2**53
"""Whole numbers up to here are exact in double precision."""


def write_ply(path: str | os.PathLike[str], cloud: PointCloud, extra: Mapping[str, Array] | None = None) -> None:
    """Write a cloud as binary little endian PLY, whole or not at all.

    Coordinates are written as the file had them, without the shift: float if they came as float32 and there is no
    shift, else double. All fields keep name and type, except for what PLY has no form for:

    * a field (n, k) becomes k properties `name_0` to `name_k-1`;
    * bool becomes uchar, float16 float; a 64-bit integer becomes int or uint if its values fit, else double, with a
      warning if values beyond 2^53 lose digits;
    * characters that a property name may not have become ``_``, and a name that is taken gets `_2`.

    Parameters
    ----------
    path : path
        Where to; ``-`` is standard output.
    cloud : PointCloud
    extra : mapping of str to (n, ...) array, optional
        Further fields, behind the cloud's own; one of the same name replaces it.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    rows = vertex_rows(cloud, {**cloud.fields, **(extra or {})})
    element = PlyElement.describe(rows, "vertex")
    with open_output(path, binary=True) as stream:
        PlyData([element], byte_order="<").write(stream)


def vertex_rows(cloud: PointCloud, fields: Mapping[str, Array]) -> Array:
    """Return the structured array (n,) of the vertices."""
    small = cloud.coordinate_type is np.float32 and not cloud.shift.any()
    columns: dict[str, Array] = {}
    world = cloud.world().astype(np.float32 if small else np.float64)
    for axis, name in enumerate("xyz"):
        columns[name] = world[:, axis]
    for name, values in fields.items():
        for part, column in scalar_columns(name, values):
            columns[free_name(part, columns)] = storable(name, column)
    rows = np.empty(len(cloud), [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    return rows


def storable(name: str, values: Array) -> Array:
    """Return values (n,) in a type that PLY has; see :func:`write_ply`."""
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind == "b":
        return values.astype(np.uint8)
    if kind == "f":
        return values if size in (4, 8) else values.astype(np.float32 if size < 4 else np.float64)
    if size < 8:
        return values
    low, high = (int(values.min()), int(values.max())) if len(values) else (0, 0)
    for narrow in (np.int32, np.uint32):
        if np.iinfo(narrow).min <= low and high <= np.iinfo(narrow).max:
            return values.astype(narrow)
    if max(-low, high) > LARGEST_EXACT:
        logger.warning("field %s is rounded: PLY has no 64-bit integers, and double holds them exactly to 2^53", name)
    return values.astype(np.float64)
