"""Worlds from elsewhere: GeoJSON, grid maps of ROS (map_server's yaml file and image), and draws from the prior."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.model.arak import exact_draws
from prf.model.window import Window
from prf.results.geojson import area_of_cells, outline_of_cells
from prf.results.score import OccupiedArea, read_occupied_area
from prf.shell.cli.files import open_input
from prf.shell.errors import ConfigError, InputError
from prf.simulate.world import World

MARGIN = 1.0  # metres of free space round polygons without a window
MAX_DRAWS = 1000
YAML_SUFFIXES = (".yaml", ".yml")
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65  # of a yaml file that has none
PADDING = 2  # occupied cells round the map, so that no wall touches the window at a point
TOLERANCE = 1.0  # cells by which contours may be off: staircases of slanted walls become straight
ENTRY = re.compile(r"^(\w+)\s*:\s*([^#\n]*?)\s*(?:#.*)?$", re.MULTILINE)


class DrawnWorld(NamedTuple):
    """A world drawn from the prior, and how many draws went before it."""

    world: World
    n_redrawn: int


def read_world(path: str | os.PathLike[str]) -> World:
    """Read a world from GeoJSON polygons of occupied area, or from the yaml file of a ROS map.

    `path`: geoJSON of any program, in metres; a property ``window`` is kept. Unknown cells of a ROS map are occupied.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        return world_of_cells(read_cell_map(path))
    area = read_occupied_area(path)
    if area.window is None and area.region.is_empty:
        raise InputError(f"{path}: expected polygons of the occupied area, or a property window.")
    window = area.window or Window.beyond(area.region.bounds, MARGIN)
    try:
        return World.from_polygons(area.region, window)
    except InputError as error:
        raise InputError(f"{path}: {error}. Separate polygons that touch at a point.") from error


def draw_world(scale: float, window: Window, rng: np.random.Generator, accept: Callable[[World], bool]) -> DrawnWorld:
    """Draw from the Arak process until a draw can be used.

    `scale`: p in 1/m. `accept`: whether a world can be used. The world returned is a draw from the prior given that it
    can.
    """
    for n_redrawn in range(MAX_DRAWS):
        world = World.from_coloring(exact_draws(scale, window, 1, rng)[0])
        if accept(world):
            return DrawnWorld(world, n_redrawn)
    raise ConfigError(
        f"scale {scale:g}: none of {MAX_DRAWS} draws leaves enough free space. Take a smaller scale, or another size."
    )


class CellMap(NamedTuple):
    """A grid map."""

    # occupied, unknown: (ny, nx) row 0 has the lowest y; free is what is neither
    occupied: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    origin: tuple[float, float]  # lower left corner of cell (0, 0), metres
    resolution: float  # side of a cell, metres

    def window(self, padding: int = 0) -> Window:
        """Return the window of the cells and `padding` more round them."""
        ny, nx = self.occupied.shape
        x0, y0 = (at - padding * self.resolution for at in self.origin)
        side = self.resolution
        return Window.checked(x0, y0, x0 + (nx + 2 * padding) * side, y0 + (ny + 2 * padding) * side)


def read_cell_map(path: str | os.PathLike[str]) -> CellMap:
    """Read the yaml file of a map of mode trinary, whose image is named relative to it (https://wiki.ros.org/map_server)."""
    with open_input(path) as stream:
        entries = dict(ENTRY.findall(stream.read().decode("utf-8", "replace")))
    try:
        x, y, yaw = map(float, entries["origin"].strip("[]").split(","))
        resolution = float(entries["resolution"])
        free = float(entries.get("free_thresh", FREE_THRESHOLD))
        taken = float(entries.get("occupied_thresh", OCCUPIED_THRESHOLD))
        shade = _shades(Path(path).parent / entries["image"].strip("'\""))
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: not the yaml file of a map_server map ({error}). It has image, resolution and origin [x, y, yaw]."
        ) from error
    if yaw != 0.0 or entries.get("mode", "trinary") != "trinary":
        raise InputError(f"{path}: only maps of mode trinary that are not turned (yaw 0) can be read.")
    occupancy = shade if entries.get("negate", "0").lower() in ("1", "true") else 1.0 - shade
    cells = CellMap(occupancy > taken, (occupancy >= free) & (occupancy <= taken), (x, y), resolution)
    try:
        cells.window(PADDING)
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from error
    return cells


def _shades(path: Path) -> NDArray[np.float64]:
    """Return an image from 0 (black) to 1 (white), (ny, nx), the lowest row first."""
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it, and only these maps need it

    with open_input(path) as stream:
        try:
            with Image.open(stream) as image:
                return np.asarray(image.convert("L"), dtype=np.float64)[::-1] / 255.0
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"{path}: not an image that can be read ({reason}).") from error


def area_of_map(cells: CellMap) -> OccupiedArea:
    """Return the occupied area, staircases straightened, in the map's window."""
    return OccupiedArea(area_of_cells(cells.occupied, np.array(cells.origin), cells.resolution), cells.window())


def world_of_cells(cells: CellMap) -> World:
    """Return the world of a grid map, walls straight to about a cell.

    Cells that touch at a corner alone are joined, since a wall has an inside and an outside everywhere.
    """
    taken = _joined(np.pad(cells.occupied | cells.unknown, PADDING, constant_values=True))
    window = cells.window(PADDING)
    contours = outline_of_cells(taken, np.array(window[:2]), cells.resolution)
    return World.from_polygons(shapely.simplify(contours, TOLERANCE * cells.resolution), window)


def _joined(taken: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return cells after filling one beside every two that touch at a corner alone."""
    joined = taken.copy()
    while True:
        lower, upper = joined[:-1], joined[1:]
        rising = lower[:, :-1] & upper[:, 1:] & ~lower[:, 1:] & ~upper[:, :-1]
        falling = lower[:, 1:] & upper[:, :-1] & ~lower[:, :-1] & ~upper[:, 1:]
        if not (rising.any() or falling.any()):
            return joined
        joined[:-1, 1:] |= rising
        joined[:-1, :-1] |= falling
