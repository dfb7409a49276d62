"""Worlds from grid maps of ROS: the yaml file and image of map_server, contours of occupied cells made straight."""

from __future__ import annotations

import io
import math
import os
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.coloring.polygons import from_segments, occupied_polygons
from prf.shell.errors import ConfigError, InputError
from prf.shell.files import open_input
from prf.simulate.world import Floats, World
from prf.window import Window

FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
"""Where the file has none, and for images that hold probabilities."""
PADDING = 2
"""Cells round the map that are as unknown ones, so that no wall touches the window at a point."""
TOLERANCE = 1.0
"""Cells by which contours may be off: staircases of slanted walls become straight."""
MODES = ("trinary", "scale", "raw")


class CellMap(NamedTuple):
    """What a grid map says.

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
    """Read a map as ROS's map_server does (https://wiki.ros.org/map_server).

    Parameters
    ----------
    path : path
        The yaml file; the image stands where it says, relative to itself.

    Raises
    ------
    InputError
        If either file is missing or damaged.
    """
    content = _load_yaml(path)
    x, y, yaw = _numbers(path, content, "origin", 3)
    (resolution,) = _numbers(path, content, "resolution", 1)
    if resolution <= 0.0:
        raise InputError(f"{path}: resolution {resolution:g}, must be a positive number of metres.")
    mode = content.get("mode", MODES[0])
    if mode not in MODES:
        raise InputError(f"{path}: mode {_shown(mode)}, must be one of {', '.join(MODES)}.")
    if not isinstance(content.get("image"), str):
        raise InputError(f"{path}: no image is named. Give the yaml file of a map_server map.")
    try:
        shade, opaque = _load_image(Path(path).parent / content["image"])
    except InputError as error:
        raise InputError(f"{path}: image {error}") from error
    occupancy = shade if _is_true(content.get("negate", 0)) else 1.0 - shade
    known = opaque.copy()
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


def world_of_cells(cells: CellMap, unknown_is_occupied: bool) -> World:
    """Return the world of a grid map, walls straight to about a cell.

    Cells that touch at a corner alone are joined, since a wall has an inside and an outside everywhere.
    """
    taken = cells.occupied | (cells.unknown & unknown_is_occupied)
    taken = np.pad(taken, PADDING, constant_values=unknown_is_occupied)
    window = cells.window(PADDING)
    contours = cell_contours(_joined(taken))
    outlines = shapely.transform(contours, lambda xy: xy * cells.resolution + np.array([window.x_min, window.y_min]))
    return World.from_polygons(shapely.simplify(outlines, TOLERANCE * cells.resolution), window)


def cell_contours(taken: NDArray[np.bool_]) -> BaseGeometry:
    """Return the area of cells (ny, nx) of side 1 that are true; none may touch another at a corner alone."""
    ny, nx = taken.shape
    lines = np.concatenate([_runs(taken), _runs(taken.T)[:, :, ::-1]])
    grid = Window(0.0, 0.0, float(nx), float(ny))
    coloring = from_segments(lines, grid)
    if len(lines) == 0:
        return occupied_polygons(coloring._replace(anchor_black=bool(taken.any())))
    # The anchor may lie on a contour, so its colour is found by trying: the other one is wrong everywhere.
    area = occupied_polygons(coloring)
    row, column = np.argwhere(taken)[0]
    if shapely.intersects_xy(area, column + 0.5, row + 0.5):
        return area
    return occupied_polygons(coloring._replace(anchor_black=True))


def _runs(taken: NDArray[np.bool_]) -> Floats:
    """Return the straight lines (n, 2, 2) between rows whose cells differ, x first, in cells; none on the border."""
    # +1: free below and taken above; -1 the other way round. Where it changes, the contour turns.
    step = np.diff(taken.astype(np.int8), axis=0)
    change = np.diff(np.pad(step, ((0, 0), (1, 1))), axis=1) != 0
    row, at = np.nonzero(change)
    begins = np.pad(step, ((0, 0), (0, 1)))[row, at] != 0
    here = np.flatnonzero(begins)
    # The end of a run is the next change in its row, where another may begin at once.
    y = row[here] + 1.0
    first, last = at[here].astype(np.float64), at[here + 1].astype(np.float64)
    return np.stack([np.stack([first, y], axis=1), np.stack([last, y], axis=1)], axis=1)


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


def _load_yaml(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    from ruamel.yaml import YAML  # noqa: PLC0415 - takes a while, and only these maps need it

    with open_input(path) as stream:
        text = stream.read()
        try:
            content = YAML(typ="safe", pure=True).load(text)
        except Exception as error:  # beside its own: of digits and nesting without end, and of tags that do not fit
            raise InputError(f"{path}: not YAML ({_words(error)}).") from error
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: not the yaml file of a map_server map. It has image, resolution and origin.")
    return content


def _numbers(
    path: str | os.PathLike[str], content: Mapping[str, Any], key: str, n: int, default: float | None = None
) -> list[float]:
    """Return the number or the list of n numbers under a key."""
    value = content.get(key, default)
    values = value if isinstance(value, list) else [value]
    try:
        numbers = [float(item) for item in values]
    except (TypeError, ValueError, OverflowError):
        numbers = []
    if len(numbers) != n or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"{path}: {key} is {_shown(value)}, must be {'a number' if n == 1 else f'{n} numbers'}.")
    return numbers


def _is_true(value: object) -> bool:
    """Return what YAML writers mean by 0, 1, false and true."""
    return value == 1 or (isinstance(value, str) and value.lower() in ("1", "true"))


def _shown(value: object) -> str:
    """Return a value in few characters: a list that holds itself, or another twice and so on, has no end."""
    try:
        return reprlib.repr(value)[:80]
    except ValueError:  # a whole number of too many digits
        return f"a {type(value).__name__} without end"


def _words(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _pixels(data: bytes, suffix: str) -> NDArray[Any]:
    """Return the pixels of an image: floats up to 1, bytes, or integers up to 65535."""
    from matplotlib.image import imread  # noqa: PLC0415 - as above
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it

    with Image.open(io.BytesIO(data)) as image:
        if image.mode == "I":  # a PGM of two bytes a pixel, of which matplotlib makes bytes by cutting at 255
            return np.asarray(image)
    return np.asarray(imread(io.BytesIO(data), format=suffix or None))


def _load_image(path: Path) -> tuple[Floats, NDArray[np.bool_]]:
    """Return shade (0 black to 1 white) and whether it is opaque, both (ny, nx), the top row first."""
    try:
        with open_input(path) as stream:
            pixels = _pixels(stream.read(), path.suffix.lstrip(".").lower())
    except InputError:
        raise
    except Exception as error:  # each format raises its own, and there are bombs
        raise InputError(f"{path}: not an image that can be read ({_words(error)}).") from error
    most = 1.0 if pixels.dtype.kind == "f" else 255.0 if pixels.dtype.itemsize == 1 else 65535.0
    levels = pixels.astype(np.float64) / most
    if levels.ndim == 2:
        return levels, np.ones(levels.shape, dtype=np.bool_)
    n_colours = 3 if levels.shape[2] >= 3 else 1
    has_alpha = levels.shape[2] in (2, 4)
    opaque = levels[..., -1] > 0.5 if has_alpha else np.ones(levels.shape[:2], dtype=np.bool_)
    return levels[..., :n_colours].mean(axis=-1), opaque
