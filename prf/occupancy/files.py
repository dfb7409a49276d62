"""The GRID file: one .npz archive (docs/occupancy-grids.md)."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.occupancy.model import OccupancyGrid
from prf.shell.files import open_input
from prf.shell.jsonout import jsonable
from prf.shell.storage import damaged, load_arrays, save_arrays, take_array

SCHEMA = "prf.grid/1"
ARCHIVE_MAGIC = b"PK"


def is_grid(path: str | os.PathLike[str]) -> bool:
    """Return whether `path` is an archive, as a GRID file is; what is in it is for :func:`read_grid` to judge.

    Raises
    ------
    InputError
        If it may not be read.
    """
    if not Path(path).is_file():
        return False
    with open_input(path) as stream:
        return stream.read(2) == ARCHIVE_MAGIC


def write_grid(path: str | os.PathLike[str], grid: OccupancyGrid) -> None:
    """Write a GRID file, whole or not at all (OutputError if it cannot be written)."""
    arrays = {
        "occupancy": grid.occupancy,
        "hits": grid.hits,
        "misses": grid.misses,
        "origin": grid.origin,
        "resolution": np.float64(grid.resolution),
        "settings": np.str_(json.dumps(jsonable(grid.settings), allow_nan=False)),
        "process": np.str_(json.dumps(jsonable(grid.process), allow_nan=False)),
    }
    save_arrays(Path(path), SCHEMA, arrays)


def read_grid(path: str | os.PathLike[str]) -> OccupancyGrid:
    """Read a GRID file.

    Raises
    ------
    InputError
        If the file is missing, damaged, or of another schema.
    """
    file = Path(path)
    arrays = load_arrays(file, SCHEMA)
    occupancy = take_array(file, arrays, "occupancy", np.float32, (None, None))
    grid = OccupancyGrid(
        occupancy,
        take_array(file, arrays, "hits", np.int32, occupancy.shape),
        take_array(file, arrays, "misses", np.int32, occupancy.shape),
        take_array(file, arrays, "origin", np.float64, (2,)),
        float(take_array(file, arrays, "resolution", np.float64, ())),
        _object(file, arrays, "settings"),
        _object(file, arrays, "process"),
    )
    _check(file, grid)
    return grid


def _object(file: Path, arrays: dict[str, NDArray[Any]], name: str) -> dict[str, Any]:
    try:
        content = json.loads(str(arrays[name]))
    except (KeyError, ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise damaged(file, f"array {name} holds no JSON object")
    return content


def _check(file: Path, grid: OccupancyGrid) -> None:
    if grid.occupancy.size == 0:
        raise damaged(file, "no cell")
    if not ((grid.occupancy >= 0.0) & (grid.occupancy <= 1.0)).all():
        raise damaged(file, "array occupancy holds something else than probabilities")
    if not (np.isfinite(grid.origin).all() and 0.0 < grid.resolution < np.inf):
        raise damaged(file, f"origin {grid.origin.tolist()}, resolution {grid.resolution}")
