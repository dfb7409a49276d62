"""Arrays and JSON objects, each with the name and version of its schema, and what repeats a result.

They are on disk, or JSON on standard output. A result is repeated by its seed, digests of its inputs, versions of the
programs and the machine. Numpy is imported where arrays are, so that what only prints JSON starts without it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import platform
import secrets
import sys
import zipfile
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prf import __version__
from prf.shell.cli.files import atomic_write, open_input
from prf.shell.errors import InputError, UsageError, system_reason

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import DTypeLike, NDArray

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
    import numpy as np

    try:
        with open_input(path) as stream, np.errstate(all="ignore"), np.load(stream, allow_pickle=False) as stored:
            if not isinstance(stored, np.lib.npyio.NpzFile):
                raise damaged(path, "not a .npz archive")
            arrays = {name: stored[name] for name in stored.files}
            if not all(isinstance(array, np.ndarray) for array in arrays.values()):
                raise damaged(path, "a member is not an array")
            found = str(arrays.pop("schema", ""))
    except InputError:
        raise
    except Exception as error:  # numpy and zipfile raise a dozen kinds for damaged bytes
        raise damaged(path, " ".join(str(error).split()) or type(error).__name__) from error
    check_schema(path, found, schema)
    return arrays


def save_arrays(path: Path, schema: str, arrays: Mapping[str, Any]) -> None:
    """Write a compressed .npz file with its schema, whole or not at all."""
    import numpy as np

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
        raise InputError(f"{path}: has no schema, expected {expected}: a file that {tool} wrote.")
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
    import numpy as np

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


def jsonable(value: Any) -> Any:
    """Return `value` as plain JSON types: nan and infinities become null, arrays lists, paths text.

    Arrays and scalars of numpy are recognised by their ``tolist``, so that numpy need not be imported.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        plain = value.tolist()
        is_finite = value.dtype.kind in "biu" or (value.dtype.kind == "f" and bool((abs(value) < math.inf).all()))
        return plain if is_finite else jsonable(plain)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: jsonable(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return jsonable(value._asdict())
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def dump_object(schema: str, content: Mapping[str, Any], indent: int | None = None) -> str:
    """Return one JSON object whose first key is ``"schema"``, e.g. ``prf.info/1``."""
    return json.dumps(jsonable({"schema": schema, **content}), indent=indent, allow_nan=False, ensure_ascii=False)


def emit_object(schema: str, content: Mapping[str, Any]) -> None:
    """Print one JSON object on standard output, as ``--json`` promises."""
    print(dump_object(schema, content))


def emit_pieces(pieces: Iterable[str]) -> None:
    """Print the pieces of one JSON object as one line, as :func:`emit_object`; they need not be held at once.

    Line feeds between values are left out; in strings JSON has none.
    """
    for piece in pieces:
        print(piece.replace("\n", ""), end="")
    print()


_PACKAGES = {"numpy": "numpy", "numba": "numba", "scipy": "scipy"}


def describe_input(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return ``{"path", "sha256", "bytes"}`` of an input; ``-`` and pipes have no digest (null).

    Of a folder of files, as of a ROS 2 bag: their bytes, and the digest of the lines ``name sha256`` of these, sorted
    by name, each ended by a line feed, without hidden ones. One that has folders, or nothing, has no digest either.
    """
    if os.path.isdir(path):
        return _describe_folder(Path(path))
    if os.fspath(path) == "-" or (os.path.exists(path) and not os.path.isfile(path)):
        # A stream has been read by now and cannot be read again.
        return {"path": os.fspath(path), "sha256": None, "bytes": None}
    try:
        with open(path, "rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            return {"path": os.fspath(path), "sha256": digest, "bytes": stream.tell()}
    except OSError as error:
        raise InputError(f"{path}: {system_reason(error)}.") from error


def _describe_folder(folder: Path) -> dict[str, Any]:
    """Return the same of a folder."""
    content = sorted(each for each in folder.iterdir() if not each.name.startswith("."))
    if not content or not all(map(Path.is_file, content)):
        return {"path": os.fspath(folder), "sha256": None, "bytes": None}
    files = [describe_input(each) for each in content]
    lines = "".join(f"{each.name} {file['sha256']}\n" for each, file in zip(content, files, strict=True))
    digest = hashlib.sha256(lines.encode("utf-8", "surrogateescape")).hexdigest()
    return {"path": os.fspath(folder), "sha256": digest, "bytes": sum(file["bytes"] for file in files)}


def versions() -> dict[str, str]:
    """Return the versions of python and of the packages that a result depends on; imports none of them."""
    found = {"python": platform.python_version(), "prf": __version__}
    for name, distribution in _PACKAGES.items():
        try:
            found[name] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found


def describe_process(inputs: Iterable[str | os.PathLike[str]] = ()) -> dict[str, Any]:
    """Return the part of a manifest that every result has: versions, platform, command, created, inputs."""
    return {
        "versions": versions(),
        "platform": {"system": platform.system(), "machine": platform.machine(), "cores": os.cpu_count()},
        "command": [*_program(), *sys.argv[1:]],
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inputs": [describe_input(path) for path in inputs],
    }


def _program() -> list[str]:
    """Return how this program was called: by its name, or as a module of Python."""
    folder, name = os.path.split(sys.argv[0])
    return ["python", "-m", os.path.basename(folder)] if name == "__main__.py" else [name]


def resolve_seed(seed: int | None) -> int:
    """Return `seed`, or draw one from the system's entropy; the caller prints and stores it.

    Drawn seeds have 32 bits: short enough to be read aloud, exact in JSON. UsageError if `seed` is negative.
    """
    if seed is None:
        return secrets.randbits(32)
    if seed < 0:
        raise UsageError(f"--seed {seed} is negative. Give an integer >= 0.")
    return seed


def spawn_generators(seed: int, n_generators: int) -> list[np.random.Generator]:
    """Return `n_generators` independent generators; the i-th depends on `seed` and i alone.

    Children of one ``SeedSequence``: a fifth chain leaves the first four as they were.
    """
    import numpy as np

    return [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(n_generators)]
