"""Writing a cloud as PLY, as CloudCompare, MeshLab and Open3D open it."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Mapping

import numpy as np
from plyfile import PlyData, PlyElement  # type: ignore[import-untyped]

from mapq.cloud import PointCloud
from mapq.io.fields import Array
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
    rows = _rows(cloud, {**cloud.fields, **(extra or {})})
    element = PlyElement.describe(rows, "vertex")
    with open_output(path, binary=True) as stream:
        PlyData([element], byte_order="<").write(stream)


def _rows(cloud: PointCloud, fields: Mapping[str, Array]) -> Array:
    """Return the structured array (n,) of the vertices."""
    small = cloud.coordinate_type is np.float32 and not cloud.shift.any()
    columns: dict[str, Array] = {}
    world = cloud.world().astype(np.float32 if small else np.float64)
    for axis, name in enumerate("xyz"):
        columns[name] = world[:, axis]
    for name, values in fields.items():
        for part, column in _scalars(name, values):
            columns[_free_name(part, columns)] = storable(name, column)
    rows = np.empty(len(cloud), [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    return rows


def _scalars(name: str, values: Array) -> Iterator[tuple[str, Array]]:
    """Yield the scalar columns of a field under their names."""
    if values.ndim == 1:
        yield name, values
        return
    flat = values.reshape(len(values), -1)
    for number in range(flat.shape[1]):
        yield f"{name}_{number}", flat[:, number]


def _free_name(name: str, taken: Mapping[str, Array]) -> str:
    """Return a property name that is valid and not taken, as near to `name` as can be."""
    valid = re.sub(r"[^!-~]", "_", name) or "field"
    free, number = valid, 2
    while free in taken:
        free, number = f"{valid}_{number}", number + 1
    if free != name:
        logger.info("field %r is written as %s", name, free)
    return free


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
