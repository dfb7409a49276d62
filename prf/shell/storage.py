"""Arrays and JSON objects on disk, each with the name and version of its schema."""

from __future__ import annotations

import json
import struct
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from prf.shell.errors import InputError, system_reason
from prf.shell.files import atomic_write, open_input
from prf.shell.gzipped import refuse_large

_REMEDY = "Write it anew, or restore it."
_ARRAY_ERRORS = (
    *(ValueError, TypeError, LookupError, SyntaxError, OverflowError, RuntimeError, SystemError, EOFError),
    *(zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError),
)
"""What numpy and zipfile raise for a damaged archive; RuntimeError has nesting and unknown packing among it."""


PACKING_LEVEL = 3
"""Of deflate: a tenth larger than with the 6 that numpy takes, in two fifths of the time."""


class OtherVersion(InputError):  # noqa: N818 - reads as what happened
    """A file of a kind that is read, in a version that is not.

    Parameters
    ----------
    message : str
    found : str
        The schema of the file.
    """

    def __init__(self, message: str, found: str) -> None:
        super().__init__(message)
        self.found = found


def load_arrays(path: Path, schema: str) -> dict[str, NDArray[Any]]:
    """Return all arrays of the .npz file `path`, whose array ``schema`` must be `schema`.

    Raises
    ------
    InputError
        If the file is missing, damaged, holds pickled objects, or is of another schema.
    """
    try:
        # Numpy multiplies a shape that a damaged header makes of numbers without end, and would warn of it.
        with open_input(path) as stream, np.errstate(all="ignore"), np.load(stream, allow_pickle=False) as stored:
            if not isinstance(stored, np.lib.npyio.NpzFile):
                raise InputError(f"{path}: not a .npz archive. {_REMEDY}")
            refuse_members(stored.zip, path)
            arrays = {name: stored[name] for name in stored.files}
    except OSError as error:
        raise InputError(f"{path}: {_reason(error)}.") from error
    except MemoryError as error:
        raise damaged(path, "an array promises more than memory holds") from error
    except _ARRAY_ERRORS as error:
        raise InputError(f"{path}: damaged ({_reason(error)}). {_REMEDY}") from error
    for name, array in arrays.items():
        if not isinstance(array, np.ndarray) or not is_text(array):  # bytes of a member that is no .npy
            raise damaged(path, f"{name} is no array, or text with characters that do not exist")
    check_schema(path, str(arrays.pop("schema", "")), schema)
    return arrays


def refuse_members(archive: zipfile.ZipFile | None, path: Path | str) -> None:
    """Raise InputError for an archive that numpy does not write: so packed, or so large, that memory could not hold it.

    Methods other than numpy's pack a thousand times as tightly as a small file should be able to.
    """
    members = archive.infolist() if archive is not None else []
    for member in members:
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise InputError(f"{path}: damaged ({member.filename} is packed as numpy never does). {_REMEDY}")
    refuse_large(sum(member.file_size for member in members), str(path))


def is_text(array: NDArray[Any]) -> bool:
    """Return whether all characters of an array of text exist; True for every other array."""
    if array.dtype.kind != "U" or array.size == 0 or array.dtype.itemsize == 0:
        return True
    codes = np.frombuffer(array.tobytes(), array.dtype.byteorder.replace("|", "=") + "u4")
    return bool(codes.max() <= sys.maxunicode)


def save_arrays(path: Path, schema: str, arrays: Mapping[str, Any]) -> None:
    """Write a compressed .npz file with its schema, whole or not at all."""
    with (
        atomic_write(path, binary=True) as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=PACKING_LEVEL) as archive,
    ):
        for name, array in {"schema": np.str_(schema), **arrays}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def load_object(path: Path, schema: str, parse_int: Callable[[str], int] = int) -> dict[str, Any]:
    """Return the JSON object in `path`, whose ``schema`` must be `schema`; errors as :func:`load_arrays`.

    `parse_int` makes whole numbers of their texts, and raises ValueError for such as must not be there.
    """
    try:
        with open_input(path) as stream:
            content = json.loads(stream.read().decode("utf-8"), parse_int=parse_int)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}:{error.lineno}: damaged ({error.msg}). {_REMEDY}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: damaged (not UTF-8 text). {_REMEDY}") from error
    except (RecursionError, ValueError) as error:  # of nesting and of whole numbers without end
        raise damaged(path, "brackets or digits without end") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: damaged (not a JSON object). {_REMEDY}")
    check_schema(path, str(content.get("schema", "")), schema)
    return content


def check_schema(path: Path, found: str, expected: str) -> None:
    """Refuse a file whose schema is not `expected`, telling another version from another kind of file."""
    if found == expected:
        return
    kind, _, version = expected.rpartition("/")
    if not found:
        tool = kind.partition(".")[0]
        raise InputError(f"{path}: no schema: this is not a file that {tool} wrote. Expected {expected}.")
    if found.startswith(f"{kind}/"):
        raise OtherVersion(
            f"{path}: version {found.rpartition('/')[2]} of {kind} is not known to this release, which reads version "
            f"{version}. Use the release that wrote it.",
            found,
        )
    raise InputError(f"{path}: schema {found}, expected {expected}.")


def take_array(
    path: Path, arrays: dict[str, NDArray[Any]], name: str, dtype: DTypeLike, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Return array `name` as C-contiguous `dtype`, checking that it is there and has `shape` (None: any length).

    Raises
    ------
    InputError
        If it is missing, or its shape or its kind of numbers differs.
    """
    if name not in arrays:
        raise InputError(f"{path}: damaged (array {name} is missing). {_REMEDY}")
    array = arrays[name]
    fits = array.ndim == len(shape) and all(
        expected in (None, n) for expected, n in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise InputError(f"{path}: damaged (array {name} has shape {array.shape}, not {wanted}). {_REMEDY}")
    if not np.can_cast(array.dtype, dtype, casting="same_kind"):
        raise InputError(f"{path}: damaged (array {name} is {array.dtype}, not {np.dtype(dtype)}). {_REMEDY}")
    return np.ascontiguousarray(array, dtype=dtype).reshape(array.shape)


def damaged(path: Path, what: str) -> InputError:
    """Return the error for content that contradicts itself."""
    return InputError(f"{path}: damaged ({what}). {_REMEDY}")


def _reason(error: BaseException) -> str:
    """Return what went wrong in one line, without numpy's advice to allow pickles."""
    if isinstance(error, OSError) and error.strerror:
        return system_reason(error)
    text = " ".join(str(error).split())
    return "holds pickled objects" if "pickle" in text else text or type(error).__name__
