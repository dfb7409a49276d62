"""What repeats a result: seeds, digests of the inputs, versions of the programs, the machine."""

from __future__ import annotations

import hashlib
import os
import platform
import secrets
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib import metadata
from typing import TYPE_CHECKING, Any

from prf import __version__
from prf.shell.errors import InputError, UsageError, system_reason

if TYPE_CHECKING:
    import numpy as np

_PACKAGES = {"numpy": "numpy", "numba": "numba", "scipy": "scipy"}


def describe_input(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return ``{"path", "sha256", "bytes"}`` of an input file; ``-`` and pipes have no digest (null)."""
    if os.fspath(path) == "-" or (os.path.exists(path) and not os.path.isfile(path)):
        # A stream has been read by now and cannot be read again.
        return {"path": os.fspath(path), "sha256": None, "bytes": None}
    try:
        with open(path, "rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
            return {"path": os.fspath(path), "sha256": digest, "bytes": stream.tell()}
    except OSError as error:
        raise InputError(f"{path}: {system_reason(error)}.") from error


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
        "command": [os.path.basename(sys.argv[0]), *sys.argv[1:]],
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "inputs": [describe_input(path) for path in inputs],
    }


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
