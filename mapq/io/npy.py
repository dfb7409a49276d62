"""Arrays of numpy: .npy and .npz, checked against the bytes at hand before memory is taken for them."""

from __future__ import annotations

import ast
import io
import struct
import warnings
import zipfile
import zlib

import numpy as np

from mapq.io.fields import NUMBERS, Array, axes_of, columns_of
from prf.shell.errors import InputError
from prf.shell.storage import is_text, refuse_members

MAGIC = b"\x93NUMPY"
ZIP_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
LONGEST_HEADER = 1 << 16

ARCHIVE_ERRORS = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, RuntimeError, struct.error)
"""What the standard library raises for a damaged archive."""


HEADER_ERRORS = (
    *(ValueError, TypeError, LookupError, SyntaxError, OverflowError, RecursionError, MemoryError),
    struct.error,
)
"""What taking a damaged header for Python's literals and numpy's types raises."""


def read_npy(data: bytes, source: str, scale_known: bool = False) -> dict[str, Array]:
    """Return the columns of a .npy file: a structured array (n,) with x, y, z, or a plain one (n, 3 or more).

    Integers X, Y, Z of a structured array are refused: so LAS keeps scaled coordinates, and the scale is not there,
    unless the caller has it (`scale_known`).

    Raises
    ------
    InputError
        For another shape or type, pickled objects, and a file that is cut off.
    """
    array = parse_array(data, source)
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
    arrays = parse_archive(data, source)
    if "schema" in arrays:
        raise InputError(f"{source}: this is {arrays['schema']}, not a cloud. Name the cloud that it was made from.")
    if "xyz" in arrays:
        xyz = arrays.pop("xyz")
        if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind not in NUMBERS:
            raise InputError(f"{source}: xyz is {xyz.dtype} of shape {xyz.shape}, expected numbers (n, 3).")
        arrays = {**_plain_columns(xyz, source), **arrays}
    axes = axes_of(list(arrays), source)
    n_points = len(arrays[axes[0]]) if arrays[axes[0]].ndim else 0
    fields = {name: values for name, values in arrays.items() if values.ndim and len(values) == n_points}
    axes_of(list(fields), source)
    return fields


def parse_archive(data: bytes, source: str) -> dict[str, Array]:
    """Return all arrays of a .npz file; its members' checksums are checked before their headers are believed.

    Raises
    ------
    InputError
        If it is damaged, or holds something else than arrays.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            refuse_members(archive, source)
            members = {name: archive.read(name) for name in archive.namelist()}
    except ARCHIVE_ERRORS as error:
        what = " ".join(str(error).split())
        raise InputError(f"{source}: damaged ({what}). Write it anew, or copy it again.") from None
    wrong = [name for name in members if not name.endswith(".npy")]
    if wrong:
        raise InputError(f"{source}: a zip archive with {wrong[0]!r}, not a .npz of arrays. Unpack it first.")
    return {name.removesuffix(".npy"): parse_array(part, f"{source}: {name}") for name, part in members.items()}


def parse_array(data: bytes, source: str) -> Array:
    """Return the array of a .npy file, a view of `data`.

    Raises
    ------
    InputError
        If the header cannot be read, promises more than follows, or tells of pickled objects.
    """
    try:
        dtype, fortran, shape, start = _array_header(data)
    except HEADER_ERRORS as error:
        raise InputError(f"{source}: not an array of numpy, or damaged ({type(error).__name__}).") from None
    if dtype.hasobject:
        raise InputError(f"{source}: holds pickled objects, which are not read. Save plain numbers.")
    size = 1
    for length in shape:
        size *= length
    if size * dtype.itemsize > len(data) - start:
        raise InputError(
            f"{source}: cut off: {size} values of {dtype.itemsize} bytes are promised, {len(data) - start} bytes "
            f"follow. Copy or write it again."
        )
    if size == 0 or dtype.itemsize == 0:
        try:
            return np.empty(shape if dtype.itemsize else 0, dtype)
        except ValueError:  # numpy counts the bytes of all but the empty axis too
            raise InputError(f"{source}: damaged: no value, in a shape without end. Write it anew.") from None
    array = np.frombuffer(data, dtype, size, start).reshape(shape, order="F" if fortran else "C")
    if not is_text(array):
        raise InputError(f"{source}: damaged: text with characters that do not exist. Write it anew.")
    return array


def _array_header(data: bytes) -> tuple[np.dtype[np.generic], bool, tuple[int, ...], int]:
    """Return type, order, shape and start of the values; the layout is that of numpy's format 1.0 to 3.0."""
    if not data.startswith(MAGIC):
        raise ValueError("no magic")
    wide = data[6] > 1
    (length,) = struct.unpack_from("<I" if wide else "<H", data, 8)
    start = (12 if wide else 10) + length
    if length > LONGEST_HEADER or start > len(data):
        raise ValueError("header is cut off")
    text = data[start - length : start].decode("utf-8" if data[6] > 2 else "latin-1").strip()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of escapes in a damaged header
        head = ast.literal_eval(text)
    shape = tuple(head["shape"])
    if not all(isinstance(n, int) and 0 <= n < 1 << 62 for n in shape) or len(shape) > 32:
        raise ValueError("shape")
    dtype = np.lib.format.descr_to_dtype(head["descr"])
    if dtype.subdtype is not None:  # numpy itself writes the inner shape as part of the outer one
        raise ValueError("type with a shape")
    return dtype, bool(head["fortran_order"]), shape, start


def _plain_columns(array: Array, source: str) -> dict[str, Array]:
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in NUMBERS:
        raise InputError(f"{source}: array {array.dtype} of shape {array.shape}, expected numbers (n, 3 or more).")
    if len(array) == 0:  # of any number of columns, as nothing follows
        raise InputError(f"{source}: no points. Check how the file was written.")
    names = [*"xyz", *(f"column_{number}" for number in range(4, array.shape[1] + 1))]
    return {name: array[:, column] for column, name in enumerate(names)}
