"""An occupancy grid: its cells, the probability of points, squares and paths, and its file (docs/scores.md).

Cells are taken as independent, which is what a grid assumes.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.kernels.state.grid import Grid
from prf.model.window import Window
from prf.results import PosteriorImage
from prf.shell.cli.files import open_input
from prf.shell.cli.storage import damaged, jsonable, load_arrays, save_arrays, take_array
from prf.shell.errors import InputError, UsageError

Floats = NDArray[np.float64]
ON_BORDER = 1e-9  # share of a cell within which a centre lies on the border of a square, which belongs to it
SCHEMA = "prf.grid/1"
ARCHIVE_MAGIC = b"PK"


@dataclasses.dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Probability of being occupied, cell by cell; row 0 has the lowest y."""

    occupancy: NDArray[np.float32]  # (ny, nx) probability that the cell is occupied; 0.5 where no reading came
    # hits, misses: (ny, nx) readings that ended in the cell, and that passed it
    hits: NDArray[np.int32]
    misses: NDArray[np.int32]
    origin: NDArray[np.float64]  # (2,) lower left corner of cell (0, 0) in metres
    resolution: float  # side of a cell in metres
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)  # configuration as resolved, in SI units
    process: dict[str, Any] = dataclasses.field(default_factory=dict)  # versions, command, digests of the inputs

    @property
    def cells(self) -> Grid:
        """The grid as kernels take it."""
        n_rows, n_columns = self.occupancy.shape
        return Grid(float(self.origin[0]), float(self.origin[1]), self.resolution, n_columns, n_rows)

    @property
    def window(self) -> Window:
        """The rectangle that the cells fill."""
        x, y = self.origin.tolist()
        n_rows, n_columns = self.occupancy.shape
        return Window(x, y, x + n_columns * self.resolution, y + n_rows * self.resolution)

    def image(self) -> PosteriorImage:
        """Return the probabilities as an image; a grid has no other value for squares than for points."""
        return PosteriorImage(self.occupancy, self.occupancy, self.origin, self.resolution, self.seen)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which cells (ny, nx) some reading reached."""
        reached: NDArray[np.bool_] = (self.hits + self.misses) > 0
        return reached

    @property
    def share_seen(self) -> float:
        """Share of the cells that some reading reached."""
        return float(np.mean(self.seen))


def occupied_probability(grid: OccupancyGrid, xy: ArrayLike, square: float = 0.0) -> Floats:
    """Return how probably each point, or the square round it, is occupied.

    `xy` (n_points, 2): points in metres. `square`: side of the closed square in metres: one minus the product of 1 - p
    over the cells whose centres lie in it. Where there is none, as with 0, the cell of the point. Returns (n_points,):
    probabilities; nan for a point outside the grid.
    """
    if not 0.0 <= square < np.inf:
        raise UsageError(f"square {square} m: the side of a square is a finite number >= 0.")
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    inside = grid.window.contains(points)
    answers = np.full(len(points), np.nan)
    place = (points[inside] - grid.origin) / grid.resolution
    most = np.array(grid.occupancy.shape[::-1]) - 1
    own = np.minimum(place.astype(np.int64), most)
    reach = 0.5 * square / grid.resolution + ON_BORDER
    low = np.clip(np.ceil(place - 0.5 - reach), 0, most + 1).astype(np.int64)
    high = np.clip(np.floor(place - 0.5 + reach) + 1, 0, most + 1).astype(np.int64)
    several = (low < high).all(axis=1) & (square > 0.0)
    free = np.where(several, _log_free_sums(grid, low, high), 0.0)
    alone = grid.occupancy[own[:, 1], own[:, 0]]
    answers[inside] = np.where(several, -np.expm1(free), alone)
    return answers


def path_free(grid: OccupancyGrid, path_xy: ArrayLike, radius: float) -> float:
    """Return the probability that a disc can follow the whole path: the product of 1 - p over the cells it touches.

    `path_xy` (n_points, 2): corners of the path in metres, in order. `radius`: radius of the disc in metres, >= 0.
    Returns: nan if a part of the path lies outside the grid.
    """
    path = np.asarray(path_xy, dtype=np.float64).reshape(-1, 2)
    if len(path) == 0:
        raise InputError("the path has no point.")
    if not 0.0 <= radius < np.inf:
        raise UsageError(f"radius {radius} m: the radius of a disc is a finite number >= 0.")
    if not grid.window.contains(path).all():
        return float("nan")
    most = np.array(grid.occupancy.shape[::-1])
    low = np.clip(np.floor((path.min(axis=0) - radius - grid.origin) / grid.resolution), 0, most - 1).astype(int)
    high = np.clip(np.ceil((path.max(axis=0) + radius - grid.origin) / grid.resolution), 1, most).astype(int)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    corner = grid.origin + grid.resolution * np.column_stack([columns.ravel(), rows.ravel()])
    boxes = shapely.box(corner[:, 0], corner[:, 1], *(corner + grid.resolution).T)
    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    shapely.prepare(line)
    touched = shapely.dwithin(boxes, line, radius)
    return float(np.exp(_log_free(grid)[rows.ravel()[touched], columns.ravel()[touched]].sum()))


def _log_free(grid: OccupancyGrid) -> Floats:
    """Return log(1 - p) of every cell, kept finite so that sums of many can be subtracted."""
    return np.log1p(-np.minimum(grid.occupancy.astype(np.float64), 1.0 - 1e-12))


def _log_free_sums(grid: OccupancyGrid, low: NDArray[np.int64], high: NDArray[np.int64]) -> Floats:
    """Return the sums of log(1 - p) over columns and rows from `low` up to before `high`, each (n, 2)."""
    table = np.zeros(np.array(grid.occupancy.shape) + 1)
    table[1:, 1:] = _log_free(grid).cumsum(axis=0).cumsum(axis=1)
    (x0, y0), (x1, y1) = low.T, high.T
    sums: Floats = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    return np.minimum(sums, 0.0)


def is_grid(path: str | os.PathLike[str]) -> bool:
    """Return whether `path` is an archive, as a GRID file is; what is in it is for :func:`read_grid` to judge."""
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
    """Read a GRID file."""
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
