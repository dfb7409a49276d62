"""Names of outputs that promise another format than the one that is written: other programs believe them."""

from __future__ import annotations

import os
from collections.abc import Collection

from prf.shell.errors import UsageError

CLOUDS = (".3d", ".asc", ".bin", ".e57", ".las", ".laz", ".pcd", ".ply", ".pts", ".ptx", ".vtk", ".xyz")
MAPS = (".dxf", ".geojson", ".geojsonl", ".nc", ".netcdf", ".pgm")
PICTURES = (".htm", ".html", ".jpeg", ".jpg", ".pdf", ".png", ".svg")
LOGS = (".bag", ".csv", ".db3", ".mcap", ".txt")
OTHERS = (".gz", ".npy", ".npz", ".toml", ".yaml", ".yml", ".zip")
FORMATS = (*CLOUDS, *MAPS, *PICTURES, *LOGS, *OTHERS)
"""Suffixes that name a format. A suffix that is not among them, such as .json, may be that of any output."""


def refuse_other_format(path: str | os.PathLike[str], own: Collection[str], advice: str) -> None:
    """Refuse the name of a format that is not written, before the work for it begins.

    Parameters
    ----------
    path : path
        Of the output.
    own : collection of str
        Suffixes of `FORMATS` that the output may have.
    advice : str
        What is written, and what to do: the rest of the message.

    Raises
    ------
    UsageError
    """
    name = os.fspath(path).lower()
    if name.endswith(FORMATS) and not name.endswith(tuple(own)):
        raise UsageError(f"{path}: {advice}")
