"""Files of arrays with names: MATLAB's .mat, and .npz of numpy; which of them are poses."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError, require

Floats = NDArray[np.float64]

MATLAB, MATLAB_HDF5, ZIP = b"MATLAB 5.0 MAT", b"MATLAB 7.3 MAT", b"PK\x03\x04"
POSE_WIDTHS = (3, 4, 7, 8, 12, 16)
"""Numbers of a pose: x y theta, a time and these, place and quaternion, a time and these, matrices."""
ODOMETRY = re.compile("odo", re.IGNORECASE)
"""What names of odometry have in them."""


def is_named(data: bytes) -> bool:
    """Return whether content, decompressed, is a file of named arrays."""
    return data.startswith((MATLAB, MATLAB_HDF5)) or (data.startswith(ZIP) and b".npy" in data[:200])


def named_arrays(data: bytes, source: str) -> dict[str, Floats]:
    """Return the numbers in a file by name, each (n, w); the names of fields of structs have dots.

    A vector is a column. Motions 4x4xN become rows of 16 numbers, motions 3x3xN rows x y theta; cells and arrays of
    structs become rows where they hold vectors of one length.
    """
    try:
        content = _content(data, source)
    except (ValueError, TypeError, OSError, KeyError, EOFError, NotImplementedError) as error:
        raise InputError(f"{source}: damaged or cut off ({error}). Save it again.") from error
    found: dict[str, Floats] = {}
    for name, value in content.items():
        found.update(_flat(name, value))
    if not found:
        hint = " Objects such as lidarScan are not: save their Ranges, as in R = [scans.Ranges]'." if content else ""
        raise InputError(f"{source}: no array of numbers.{hint}")
    return found


def poses_in(data: bytes, source: str, is_odometry: bool) -> tuple[str, Floats]:
    """Return name and rows of the poses in a file of named arrays: of odometry those called so, else the others."""
    rows_of = {name: _pose_rows(values) for name, values in named_arrays(data, source).items()}
    found = {name: rows for name, rows in rows_of.items() if rows is not None}
    if len(found) > 1:
        found = {name: rows for name, rows in found.items() if bool(ODOMETRY.search(name)) == is_odometry} or found
    if len(found) != 1:
        listed = ", ".join(f"{name} {rows.shape[0]} x {rows.shape[1]}" for name, rows in found.items())
        what = f"several arrays may be poses ({listed})" if found else "no array of poses, such as N x 3 (x y theta)"
        raise InputError(f"{source}: {what}. Save the one to take in a file of its own.")
    return next(iter(found.items()))


def _pose_rows(values: Floats) -> Floats | None:
    """Return an array as rows of poses, None if it has not the shape of any."""
    rows = values if values.shape[1] in POSE_WIDTHS else values.T
    return rows if rows.shape[1] in POSE_WIDTHS and len(rows) > 1 else None


def _content(data: bytes, source: str) -> Mapping[str, Any]:
    if data.startswith(ZIP):
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    if data.startswith(MATLAB_HDF5):
        return _hdf5(data, source)
    from scipy.io import loadmat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of objects, which are passed over
        content = loadmat(io.BytesIO(data), simplify_cells=True)
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _hdf5(data: bytes, source: str) -> dict[str, Any]:
    """Return the plain arrays of a file of version 7.3, which stores them transposed."""
    h5py = require("h5py", "netcdf", f"{source}: a .mat of version 7.3 (or save it with -v7)")
    found: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        is_array = isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not name.startswith("#refs#")
        if is_array and item.attrs.get("MATLAB_class") != b"char":
            found[name.replace("/", ".")] = np.asarray(item).T

    with h5py.File(io.BytesIO(data), "r") as file:
        file.visititems(take)
    return found


def _flat(name: str, value: Any) -> Iterator[tuple[str, Floats]]:
    """Yield the arrays (n, w) within a value, by name."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        value = value.ravel().tolist()
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(f"{name}.{key}", item)
        return
    if isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
        for key in value[0]:
            yield from _flat(f"{name}.{key}", [each.get(key) for each in value])
        return
    if isinstance(value, list) and len({np.shape(each) for each in value}) == 1:
        value = np.array([np.ravel(each) for each in value])
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.size == 0:
        return
    numbers = value.astype(np.float64)
    if numbers.ndim == 3 and numbers.shape[:2] == (4, 4):
        yield name, np.moveaxis(numbers, 2, 0).reshape(-1, 16)
    elif numbers.ndim == 3 and numbers.shape[:2] == (3, 3):
        yield name, np.column_stack([numbers[0, 2], numbers[1, 2], np.arctan2(numbers[1, 0], numbers[0, 0])])
    elif numbers.ndim in (1, 2):
        yield name, numbers.reshape(len(numbers), -1)
