"""Arrays of numpy: .npy and .npz."""

from __future__ import annotations

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import NUMBERS, Array, axes_of, columns_of, make_cloud
from mapq.io.text import numbered_columns
from prf.shell.errors import InputError

MAGIC = b"\x93NUMPY"
ZIP_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")


def read_npy(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a .npy file: a structured array (n,) with x, y, z, or a plain one (n, 3 or more).

    Integers X, Y, Z of a structured array are refused without a unit: so PDAL and laspy store the scaled coordinates
    of LAS.
    """
    source = content.source
    with content.stream() as stream:
        array = np.load(stream, allow_pickle=False)
    fields = _plain_columns(array, source) if array.dtype.names is None else columns_of(array)
    axes = axes_of(list(fields), source)
    if options.unit is None and axes[0] == "X" and all(fields[name].dtype.kind in "iu" for name in axes):
        raise InputError(
            f"{source}: X, Y, Z are integers: scaled coordinates of LAS, without the scale. Give it in metres with "
            f"--unit, such as --unit 0.01."
        )
    return make_cloud(fields, source, options.unit or 1.0)


def read_npz(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a .npz file: ``xyz`` (n, 3) or x, y, z (n,), and every other array of n rows."""
    source = content.source
    with content.stream() as stream, np.load(stream, allow_pickle=False) as archive:
        if "schema" in archive.files:
            raise InputError(f"{source}: this is {archive['schema']}, not a cloud. Name the cloud it was made from.")
        arrays = {name: archive[name] for name in archive.files}
    if "xyz" in arrays:
        arrays = {**_plain_columns(arrays.pop("xyz"), source), **arrays}
    n_points = np.shape(arrays[axes_of(list(arrays), source)[0]])[:1]
    fields = {name: values for name, values in arrays.items() if np.shape(values)[:1] == n_points != ()}
    return make_cloud(fields, source, options.unit or 1.0)


def _plain_columns(array: Array, source: str) -> dict[str, Array]:
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in NUMBERS:
        raise InputError(f"{source}: array {array.dtype} of shape {array.shape}, expected numbers (n, 3 or more).")
    return dict(zip([*"xyz", *numbered_columns(array.shape[1])], array.T, strict=True))
