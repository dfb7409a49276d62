"""Worlds from elsewhere: GeoJSON, grid maps of ROS (map_server's yaml file and image), and draws from the prior.

What map_server makes of an image: https://wiki.ros.org/map_server.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.arak import exact_draws
from prf.score import read_occupied_area
from prf.score.polygons import area_of_cells, outline_of_cells
from prf.shell.errors import ConfigError, InputError
from prf.shell.files import open_input
from prf.simulate.world import Floats, World
from prf.window import Window

MARGIN = 1.0
"""Metres of free space round polygons without a window."""
MAX_DRAWS = 1000
YAML_SUFFIXES = (".yaml", ".yml")
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
"""Where the file has none, and for images that hold probabilities."""
PADDING = 2
"""Cells round the map that are as unknown ones, so that no wall touches the window at a point."""
TOLERANCE = 1.0
"""Cells by which contours may be off: staircases of slanted walls become straight."""
MODES = ("trinary", "scale", "raw")


class DrawnWorld(NamedTuple):
    """A world drawn from the prior, and how many draws went before it."""

    world: World
    n_redrawn: int


def read_world(path: str | os.PathLike[str], unknown_is_occupied: bool = False) -> World:
    """Read a world from GeoJSON polygons of occupied area, or from the yaml file of a ROS map.

    Parameters
    ----------
    path : path
        GeoJSON of any program, in metres; a property ``window`` is kept.
    unknown_is_occupied : bool
        What unknown cells of a ROS map become, and what lies round it.

    Raises
    ------
    InputError
        If it cannot be read, or its walls have no inside and outside: polygons that touch at a point; or if a ROS map
        is turned against the axes.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        cells = read_cell_map(path)
        if cells.yaw != 0.0:
            raise InputError(f"{path}: origin has the yaw {cells.yaw:g}. A turned map is no world: turn it back first.")
        return world_of_cells(cells, unknown_is_occupied)
    area = read_occupied_area(path)
    if area.window is None and area.region.is_empty:
        raise InputError(f"{path}: neither a polygon nor a window. Give polygons of the occupied area.")
    window = area.window or Window.beyond(area.region.bounds, MARGIN)
    try:
        return World.from_polygons(area.region, window)
    except InputError as error:
        raise InputError(f"{path}: {error}. Part polygons that touch at a point.") from error


def draw_world(scale: float, window: Window, rng: np.random.Generator, accept: Callable[[World], bool]) -> DrawnWorld:
    """Draw from the Arak process until a draw can be used.

    Parameters
    ----------
    scale : float
        p in 1/m.
    accept : callable
        Whether a world can be used. The world returned is a draw from the prior given that it can.
    """
    for n_redrawn in range(MAX_DRAWS):
        world = World.from_coloring(exact_draws(scale, window, 1, rng)[0])
        if accept(world):
            return DrawnWorld(world, n_redrawn)
    raise ConfigError(
        f"scale {scale:g}: none of {MAX_DRAWS} draws leaves enough free space. Take a smaller scale, or another size."
    )


class CellMap(NamedTuple):
    """A grid map.

    Attributes
    ----------
    occupied, unknown : (ny, nx) bool
        Row 0 has the lowest y; free is what is neither.
    origin : (float, float)
        Lower left corner of cell (0, 0), metres.
    resolution : float
        Side of a cell, metres.
    yaw : float
        By which the map is turned round its origin, radians, counter-clockwise.
    """

    occupied: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    origin: tuple[float, float]
    resolution: float
    yaw: float = 0.0

    def window(self, padding: int = 0) -> Window:
        """Return the window of the cells and `padding` more round them, as if the map were not turned."""
        ny, nx = self.occupied.shape
        x0, y0 = (at - padding * self.resolution for at in self.origin)
        side = self.resolution
        return Window.checked(x0, y0, x0 + (nx + 2 * padding) * side, y0 + (ny + 2 * padding) * side)


def read_cell_map(path: str | os.PathLike[str]) -> CellMap:
    """Read the yaml file of a map, whose image is named relative to it (InputError if either is damaged)."""
    content = _entries(path)
    x, y, yaw = _numbers(path, content, "origin", 3)
    (resolution,) = _numbers(path, content, "resolution", 1)
    if resolution <= 0.0:
        raise InputError(f"{path}: resolution {resolution:g}, must be a positive number of metres.")
    mode, image = content.get("mode", [MODES[0]])[0], content.get("image", [""])[0]
    if mode not in MODES:
        raise InputError(f"{path}: mode {mode!r}, must be one of {', '.join(MODES)}.")
    if not image:
        raise InputError(f"{path}: no image is named. Give the yaml file of a map_server map.")
    try:
        shade, known = _load_image(Path(path).parent / image)
    except InputError as error:
        raise InputError(f"{path}: image {error}") from error
    occupancy = shade if content.get("negate", ["0"])[0].lower() in ("1", "true") else 1.0 - shade
    free, taken = FREE_THRESHOLD, OCCUPIED_THRESHOLD
    if mode == "raw":
        value = np.rint(255.0 * shade)
        occupancy, known = value / 100.0, value <= 100.0
    elif mode == "trinary":
        (free,) = _numbers(path, content, "free_thresh", 1, free)
        (taken,) = _numbers(path, content, "occupied_thresh", 1, taken)
    occupied = known & (occupancy > taken)
    unknown = ~known | ((occupancy >= free) & (occupancy <= taken))
    cells = CellMap(occupied[::-1], unknown[::-1], (x, y), resolution, yaw)
    try:
        cells.window(PADDING)
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from error
    return cells


def area_of_map(cells: CellMap) -> tuple[BaseGeometry, Window | None]:
    """Return the occupied area, staircases straightened, and the map's window; None if the map is turned."""
    region = area_of_cells(cells.occupied, np.array(cells.origin), cells.resolution)
    if cells.yaw == 0.0:
        return region, cells.window()
    c, s = math.cos(cells.yaw), math.sin(cells.yaw)
    turn, origin = np.array([[c, s], [-s, c]]), np.array(cells.origin)
    return shapely.transform(region, lambda xy: (xy - origin) @ turn + origin), None


def world_of_cells(cells: CellMap, unknown_is_occupied: bool) -> World:
    """Return the world of a grid map, walls straight to about a cell.

    Cells that touch at a corner alone are joined, since a wall has an inside and an outside everywhere.
    """
    taken = cells.occupied | (cells.unknown & unknown_is_occupied)
    taken = _joined(np.pad(taken, PADDING, constant_values=unknown_is_occupied))
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


def _entries(path: str | os.PathLike[str]) -> Mapping[str, list[str]]:
    """Return the values by key of the flat YAML that map_server writes: scalars, and lists in brackets or by dashes."""
    with open_input(path) as stream:
        lines = stream.read().decode("utf-8", "replace").splitlines()
    found: dict[str, list[str]] = {}
    key = ""
    for line in lines:
        name, colon, value = line.partition("#")[0].partition(":")
        if colon:
            key = name.strip()
            items = value.strip().removeprefix("[").removesuffix("]").split(",")
            found[key] = [item.strip().strip("'\"") for item in items if item.strip()]
        elif key and name.strip().startswith("- "):
            found[key].append(name.strip()[2:].strip())
    if not {"image", "resolution", "origin"} & found.keys():
        raise InputError(f"{path}: not the yaml file of a map_server map. It has image, resolution and origin.")
    return {name: values for name, values in found.items() if values}


def _numbers(
    path: str | os.PathLike[str], content: Mapping[str, list[str]], key: str, n: int, default: float | None = None
) -> list[float]:
    """Return the n numbers under a key."""
    values = content.get(key, [] if default is None else [str(default)])
    try:
        numbers = [float(item) for item in values]
    except ValueError:
        numbers = []
    if len(numbers) != n or not all(map(math.isfinite, numbers)):
        shown = ", ".join(values)[:80]
        raise InputError(f"{path}: {key} is {shown!r}, must be {'a number' if n == 1 else f'{n} numbers'}.")
    return numbers


def _load_image(path: Path) -> tuple[Floats, NDArray[np.bool_]]:
    """Return shade (0 black to 1 white) and whether it is opaque, both (ny, nx), the top row first."""
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it, and only these maps need it

    with open_input(path) as stream:
        data = stream.read()
    try:
        with Image.open(io.BytesIO(data)) as image:
            is_wide = image.mode.startswith("I")  # two bytes a pixel
            has_alpha = image.mode in ("LA", "RGBA", "PA")
            pixels = np.asarray(image if is_wide else image.convert("RGBA" if has_alpha else "RGB"), dtype=np.float64)
    except Exception as error:  # each format raises its own, and there are bombs
        raise InputError(f"{path}: not an image that can be read ({' '.join(str(error).split())[:200]}).") from error
    if is_wide:
        return pixels / 65535.0, np.ones(pixels.shape, dtype=np.bool_)
    opaque = pixels[..., 3] > 127.5 if has_alpha else np.ones(pixels.shape[:2], dtype=np.bool_)
    return (pixels[..., :3] / 255.0).mean(axis=-1), opaque
