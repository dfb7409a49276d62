"""From readings to a grid: every cell is updated on its own by every reading (inverse sensor models).

Laser beams: the cell in which a beam ends is hit, those before it are missed. Sonar cones: cells within half the
thickness of the range are hit, nearer ones in the cone are missed (Thrun, Burgard & Fox 2005, table 9.2).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration, flat_name
from prf.kernels.score.occupancy import Cells, update_beams, update_cones
from prf.kernels.state.grid import most_cells
from prf.model.laser import unit_vectors, window_exit
from prf.model.layout import image_grid
from prf.model.window import Window
from prf.readings import Kind, Readings, thin, warn_of_spoiling
from prf.readings.describe import default_max_range
from prf.readings.ground import chosen_window
from prf.results.occupancy.grid import OccupancyGrid
from prf.shell.cli.settings import Loaded
from prf.shell.errors import ConfigError, InputError

Floats = NDArray[np.float64]

USED = ("prior.window", "laser.max_range", "sonar.max_range", "sonar.cone", "readings.", "grid.")
"""What a grid takes of a configuration: its inverse models share no other parameter with the sensors' densities."""
SETTINGS = (
    *("method", "resolution", "window", "max_range", "no_return", "hit_probability", "miss_probability", "clamp"),
    *("sonar_max_range", "sonar_cone", "sonar_thickness", "topic", "sonar_topic", "frame"),
    *("poses", "pose_mount", "pose_gap", "pose_offset", "pose_quaternion"),
    *("every_scan", "every_beam", "scans", "skip_scans"),
)
"""Names of the settings in a GRID file."""
MAX_CELLS = 100_000_000  # each takes 20 bytes while the grid is built


class BuiltGrid(NamedTuple):
    """A grid, and how many readings it is made from."""

    grid: OccupancyGrid
    n_beams: int  # readings used
    n_outside: int  # readings dropped because their sensor is not inside the window


def build_grid(
    laser: Readings | None, sonar: Readings | None, config: Configuration, process: dict[str, Any] | None = None
) -> BuiltGrid:
    """Build the grid of whole logs; laser readings are entered first, each log in its own order.

    `laser`, `sonar`: not thinned yet; at least one of them. `process`: what to keep with the grid beside its settings:
    versions, digests.
    """
    beams = _rays(laser, "laser", config, config.laser.max_range)
    cones = _rays(sonar, "sonar", config, config.sonar.max_range)
    both = ((beams.origin, cones.origin), (beams.angle, cones.angle), (beams.range, cones.range))
    window = chosen_window(config.prior.window, *map(np.concatenate, both))
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
    return BuiltGrid(_finished(cells, settings, process or {}), n_used, n_all - n_used)


def grid_settings(config: Configuration) -> dict[str, Any]:
    """Return the settings that a GRID is built by, as its file has them."""
    flat = {**config.flat(), **config.grid.model_dump()}
    return {name: flat[name] for name in SETTINGS}


def grid_sources(loaded: Loaded[Configuration]) -> dict[str, str]:
    """Return what has set which value of a grid's settings."""
    return {flat_name(place): source for place, source in loaded.sources.items() if place.startswith(USED)}


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
