"""Arrays and JSON objects on disk, each with the name and version of its schema."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from prf.shell.cli.files import atomic_write, open_input
from prf.shell.errors import InputError

COMPRESSION_LEVEL = 4
"""Of deflate: the first that looks for longer matches. Draws of one chain repeat most of their vertices: those of the
Intel lab take 7 MB, with 3 they took 17 in more time; the 6 that numpy takes needs twice as long for a twentieth."""


class OtherVersion(InputError):  # noqa: N818 - reads as what happened
    """A file of a kind that is read, in a version that is not; `found` is its schema."""

    def __init__(self, message: str, found: str) -> None:
        super().__init__(message)
        self.found = found


def load_arrays(path: Path, schema: str) -> dict[str, NDArray[Any]]:
    """Return all arrays of the .npz file `path`, whose array ``schema`` must be `schema` (else InputError)."""
    try:
        with open_input(path) as stream, np.errstate(all="ignore"), np.load(stream, allow_pickle=False) as stored:
            if not isinstance(stored, np.lib.npyio.NpzFile):
                raise damaged(path, "not a .npz archive")
            arrays = {name: stored[name] for name in stored.files}
            if not all(isinstance(array, np.ndarray) for array in arrays.values()):
                raise damaged(path, "a member is no array")
            found = str(arrays.pop("schema", ""))
    except InputError:
        raise
    except Exception as error:  # numpy and zipfile raise a dozen kinds for damaged bytes
        raise damaged(path, " ".join(str(error).split()) or type(error).__name__) from error
    check_schema(path, found, schema)
    return arrays


def save_arrays(path: Path, schema: str, arrays: Mapping[str, Any]) -> None:
    """Write a compressed .npz file with its schema, whole or not at all."""
    with (
        atomic_write(path, binary=True) as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=COMPRESSION_LEVEL) as archive,
    ):
        for name, array in {"schema": np.str_(schema), **arrays}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def load_object(path: Path, schema: str) -> dict[str, Any]:
    """Return the JSON object in `path`, whose ``schema`` must be `schema`; errors as :func:`load_arrays`."""
    try:
        with open_input(path) as stream:
            content = json.loads(stream.read().decode("utf-8"))
    except json.JSONDecodeError as error:
        raise damaged(f"{path}:{error.lineno}", error.msg) from error
    except (ValueError, RecursionError) as error:
        raise damaged(path, str(error)) from error
    if not isinstance(content, dict):
        raise damaged(path, "not a JSON object")
    check_schema(path, str(content.get("schema", "")), schema)
    return content


def check_schema(path: Path, found: str, expected: str) -> None:
    """Refuse a file whose schema is not `expected`: another version (OtherVersion), or another kind of file."""
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
    """Return array `name` as C-contiguous `dtype` of `shape` (None: any length), or raise InputError."""
    if name not in arrays:
        raise damaged(path, f"array {name} is missing")
    array = arrays[name]
    if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        wanted = "(" + ", ".join("n" if n is None else str(n) for n in shape) + ")"
        raise damaged(path, f"array {name} has shape {array.shape}, not {wanted}")
    if not np.can_cast(array.dtype, dtype, casting="same_kind"):
        raise damaged(path, f"array {name} is {array.dtype}, not {np.dtype(dtype)}")
    return np.ascontiguousarray(array, dtype=dtype).reshape(array.shape)


def damaged(path: Path | str, what: str) -> InputError:
    """Return the error for content that contradicts itself."""
    return InputError(f"{path}: damaged ({what}). Write it anew, or restore it.")
