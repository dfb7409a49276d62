"""An occupancy grid, the baseline: built from readings, asked for points, squares and paths, and kept in a file.

Cells are independent of one another (paper, section 1.2): every one is updated on its own by every reading, by inverse
sensor models. Laser beams: the cell in which a beam ends is hit, those before it are missed. Sonar cones: cells within
half the thickness of the range are hit, nearer ones in the cone are missed (Thrun, Burgard & Fox 2005, table 9.2).
Answers take cells as independent (docs/scores.md).
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.configuration import Configuration
from prf.kernels.score.occupancy import Cells, update_beams, update_cones
from prf.kernels.state.grid import Grid, most_cells
from prf.model.layout import image_grid
from prf.model.ranges import unit_vectors, window_exit
from prf.model.window import Window
from prf.readings import Kind, Readings, thin, warn_of_spoiling
from prf.readings.describe import default_max_range
from prf.readings.ground import chosen_window
from prf.results import PosteriorImage
from prf.shell.cli.files import open_input
from prf.shell.cli.storage import damaged, jsonable, load_arrays, save_arrays, take_array
from prf.shell.errors import ConfigError, InputError, UsageError

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
        raise UsageError(f"square {square} m: must be a finite number of at least 0.")
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
        raise InputError("path: expected at least one point x, y.")
    if not 0.0 <= radius < np.inf:
        raise UsageError(f"radius {radius} m: must be a finite number of at least 0.")
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
        raise damaged(file, f"array {name} must hold a JSON object")
    return content


def _check(file: Path, grid: OccupancyGrid) -> None:
    if grid.occupancy.size == 0:
        raise damaged(file, "no cell")
    if not ((grid.occupancy >= 0.0) & (grid.occupancy <= 1.0)).all():
        raise damaged(file, "array occupancy must hold probabilities from 0 to 1")
    if not (np.isfinite(grid.origin).all() and 0.0 < grid.resolution < np.inf):
        raise damaged(file, f"origin {grid.origin.tolist()}, resolution {grid.resolution}")


SETTINGS = (
    *("method", "resolution", "window", "max_range", "no_return", "hit_probability", "miss_probability", "clamp"),
    *("sonar_max_range", "sonar_cone", "sonar_thickness", "topic", "sonar_topic", "frame"),
    *("poses", "pose_mount", "pose_gap", "pose_offset", "pose_quaternion"),
    *("every_scan", "every_beam", "scans", "skip_scans"),
)
"""Names of the settings in a GRID file."""
MAX_CELLS = 100_000_000  # each takes 20 bytes while the grid is built


def build_grid(
    laser: Readings | None, sonar: Readings | None, config: Configuration, process: dict[str, Any] | None = None
) -> tuple[OccupancyGrid, int, int]:
    """Build the grid of whole logs; laser readings are entered first, each log in its own order.

    `laser`, `sonar`: not thinned yet; at least one of them. `process`: what to keep with the grid beside its settings:
    versions, digests. Returns the grid, and how many readings were used, and dropped because their sensor is not inside
    the window.
    """
    beams = _rays(laser, "laser", config, config.laser.max_range)
    cones = _rays(sonar, "sonar", config, config.sonar.max_range)
    window = chosen_window(config.prior.window, (beams, cones))
    n_all = beams.n_beams + cones.n_beams
    beams = beams.select(window.contains(beams.origin, strictly=True))
    cones = cones.select(window.contains(cones.origin, strictly=True))
    n_used = beams.n_beams + cones.n_beams
    if n_used == 0:
        raise InputError("no sensor is inside the window. Check --window.")
    cells = _empty_cells(window, config)
    if config.grid.no_return == "ignore":
        beams = beams.select(np.isfinite(beams.range))
    _enter_beams(cells, beams)
    update_cones(cells, _cone_rows(cones, config))
    settings = {**grid_settings(config), "window": [*window], "max_range": beams.max_range}
    return _finished(cells, settings, process or {}), n_used, n_all - n_used


def grid_settings(config: Configuration) -> dict[str, Any]:
    """Return the settings that a GRID is built by, as its file has them."""
    flat = {**config.flat(), **config.grid.model_dump()}
    return {name: flat[name] for name in SETTINGS}


def _rays(readings: Readings | None, kind: Kind, config: Configuration, max_range: float | None) -> Readings:
    """Return the chosen readings, inf where there was no return below the maximum range."""
    if readings is None:
        return Readings.from_arrays(np.empty((0, 2)), (), ()).within(math.nan)
    # Of the whole log: what is left after thinning may hold no "no return" at all.
    limit = default_max_range(readings) if max_range is None else max_range
    if not math.isfinite(limit):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    kept = thin(readings, **config.readings.selection())
    warn_of_spoiling(readings, kept, kind, max_range)
    return kept.within(limit)


def _empty_cells(window: Window, config: Configuration) -> Cells:
    chosen = config.grid
    grid = image_grid(window, chosen.resolution)
    n = grid.nx * grid.ny
    if n > MAX_CELLS:
        raise ConfigError(f"--resolution {chosen.resolution}: more than {MAX_CELLS} cells. Give a larger one.")
    return Cells(
        grid=grid,
        hits=np.zeros(n, np.int32),
        misses=np.zeros(n, np.int32),
        log_odds=np.zeros(n),
        steps=np.array(
            [_log_odds(chosen.hit_probability), _log_odds(chosen.miss_probability), -chosen.clamp, chosen.clamp]
        ),
        path=np.empty(most_cells(grid), np.int32),
    )


def _log_odds(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


def _enter_beams(cells: Cells, beams: Readings) -> None:
    """Enter laser beams, each up to its end, its maximum range or the border of the grid."""
    grid = cells.grid
    border = Window(grid.x0, grid.y0, grid.x0 + grid.nx * grid.cell, grid.y0 + grid.ny * grid.cell)
    direction = unit_vectors(beams.angle)
    leaves = window_exit(border, beams.origin, direction)
    length = np.minimum(np.minimum(beams.range, beams.max_range), leaves)
    segments = np.hstack([beams.origin, beams.origin + length[:, None] * direction])
    update_beams(cells, segments, np.ascontiguousarray(beams.range <= length))


def _cone_rows(cones: Readings, config: Configuration) -> Floats:
    """Return what the kernel wants to know of each cone, (n, 7)."""
    opening = np.where(cones.cone > 0.0, cones.cone, config.sonar.cone)
    returned = np.isfinite(cones.range)
    near = np.minimum(cones.range, cones.max_range) - 0.5 * config.grid.sonar_thickness
    far = np.where(returned, near + config.grid.sonar_thickness, 0.0)
    columns = [np.cos(cones.angle), np.sin(cones.angle), np.cos(0.5 * opening), near, far]
    return np.ascontiguousarray(np.column_stack([cones.origin, *columns]))


def _finished(cells: Cells, settings: dict[str, Any], process: dict[str, Any]) -> OccupancyGrid:
    shape = cells.grid.ny, cells.grid.nx
    if settings["method"] == "count":
        probability = (cells.hits + 0.5) / (cells.hits + cells.misses + 1.0)
    else:
        probability = 1.0 / (1.0 + np.exp(-cells.log_odds))
    return OccupancyGrid(
        probability.astype(np.float32).reshape(shape),
        cells.hits.reshape(shape),
        cells.misses.reshape(shape),
        np.array([cells.grid.x0, cells.grid.y0]),
        cells.grid.cell,
        settings,
        process,
    )
