"""Writing a cloud in the format of its name."""

from __future__ import annotations

import os
from importlib.util import find_spec

from mapq.cloud import PointCloud
from mapq.io.las_write import write_las
from mapq.io.ply import write_ply
from prf.shell.cli.outputs import refuse_other_format
from prf.shell.errors import UsageError, install_hint

LAS_SUFFIXES = (".las", ".laz")


def write_cloud(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud: as LAS under a name that ends on .las or .laz, else as PLY; ``-`` is standard output.

    Raises
    ------
    OutputError
        If it cannot be written.
    UsageError
        As :func:`check_name`.
    """
    check_name(path)
    write = write_las if os.fspath(path).lower().endswith(LAS_SUFFIXES) else write_ply
    write(path, cloud)


def check_name(path: str | os.PathLike[str]) -> None:
    """Raise UsageError for a format that is not written, or not without an extra, before the work begins."""
    if os.fspath(path).lower().endswith(".copc.laz"):
        raise UsageError(f"{path}: COPC is not written, only plain LAZ. Name a .laz without .copc.")
    written = (".ply", *LAS_SUFFIXES)
    refuse_other_format(path, written)
    if os.fspath(path).lower().endswith(LAS_SUFFIXES) and find_spec("laspy") is None:
        raise UsageError(f"{path}: LAS needs laspy. {install_hint('las')}, or name a .ply.")
