"""Arrays of numpy: .npy and .npz."""

from __future__ import annotations

import io

import numpy as np

from mapq.io.fields import NUMBERS, Array, axes_of, columns_of
from prf.shell.errors import InputError

MAGIC = b"\x93NUMPY"
ZIP_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")


def read_npy(data: bytes, source: str, scale_known: bool = False) -> dict[str, Array]:
    """Return the columns of a .npy file: a structured array (n,) with x, y, z, or a plain one (n, 3 or more).

    Integers X, Y, Z of a structured array are refused unless the caller has their scale (`scale_known`): so PDAL and
    laspy store the scaled coordinates of LAS.
    """
    array = np.load(io.BytesIO(data), allow_pickle=False)
    if array.dtype.names is None:
        return _plain_columns(array, source)
    if array.ndim != 1:
        raise InputError(f"{source}: structured array of shape {array.shape}, expected (n,).")
    axes = axes_of(array.dtype.names, source)
    if not scale_known and axes[0] == "X" and all(array.dtype[name].kind in "iu" for name in axes):
        raise InputError(
            f"{source}: X, Y, Z are integers: scaled coordinates of LAS, without the scale. Give it in metres with "
            f"--unit, such as --unit 0.01."
        )
    return columns_of(array)


def read_npz(data: bytes, source: str) -> dict[str, Array]:
    """Return the columns of a .npz file: ``xyz`` (n, 3) or x, y, z (n,), and every other array of n rows."""
    with np.load(io.BytesIO(data), allow_pickle=False) as archive:
        if "schema" in archive.files:
            raise InputError(f"{source}: this is {archive['schema']}, not a cloud. Name the cloud it was made from.")
        arrays = {name: archive[name] for name in archive.files}
    if "xyz" in arrays:
        arrays = {**_plain_columns(arrays.pop("xyz"), source), **arrays}
    axes = axes_of(list(arrays), source)
    shape = np.shape(arrays[axes[0]])[:1]
    fields = {name: values for name, values in arrays.items() if np.shape(values)[:1] == shape != ()}
    axes_of(list(fields), source)
    return fields


def _plain_columns(array: Array, source: str) -> dict[str, Array]:
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in NUMBERS:
        raise InputError(f"{source}: array {array.dtype} of shape {array.shape}, expected numbers (n, 3 or more).")
    names = [*"xyz", *(f"column_{number}" for number in range(4, array.shape[1] + 1))]
    return {name: array[:, column] for column, name in enumerate(names)}
