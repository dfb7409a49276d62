"""The known map: GeoJSON of whatever program, or the yaml file and image of a map for ROS."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path

import numpy as np
import shapely
from matplotlib.image import imread
from numpy.typing import NDArray

from prf.score import OccupiedArea, read_occupied_area
from prf.score.polygons import area_of_cells
from prf.shell.errors import InputError
from prf.shell.files import open_input
from prf.window import Window

YAML = (".yaml", ".yml")
RAW_MOST = 100.0
"""Value of a certainly occupied pixel in mode raw; above, nothing is known."""


def read_known_map(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read the occupied area of a map file, chosen by its name: .yaml and .yml are for ROS, others are GeoJSON.

    Raises
    ------
    InputError
        If it is missing, damaged, or has nothing occupied.
    """
    area = read_ros_map(path) if Path(path).suffix.lower() in YAML else read_occupied_area(path)
    if area.region.is_empty:
        raise InputError(f"{path}: nothing is occupied in this map. Calibration needs walls.")
    return area


def read_ros_map(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read a map for ROS: pixels above ``occupied_thresh`` are occupied, all others free, staircases straightened.

    Parameters
    ----------
    path : path
        The yaml file; the image (PGM, PNG or another that matplotlib reads) stands beside it.

    Returns
    -------
    OccupiedArea
        Without a window if the map is turned (its origin has a yaw).

    Raises
    ------
    InputError
        If a file is missing or damaged, or a value is none.
    """
    with open_input(path) as stream:
        text = stream.read().decode("utf-8", errors="replace")
    try:
        values = _yaml_values(text)
        resolution = float(values["resolution"][0])
        x, y, yaw = (float(part) for part in (*values["origin"], "0", "0")[:3])
        threshold = float(values["occupied_thresh"][0])
        is_negated = values.get("negate", ["0"])[0].lower() in ("1", "true")
        mode = values.get("mode", ["trinary"])[0]
        image = Path(path).parent / values["image"][0]
    except (KeyError, IndexError, ValueError) as error:
        raise InputError(f"{path}: not the yaml file of a map for ROS ({type(error).__name__}: {error}).") from None
    if not (resolution > 0.0 and all(map(math.isfinite, (resolution, x, y, yaw)))):
        raise InputError(f"{path}: resolution {resolution}, origin {x} {y} {yaw}: must be finite, the resolution > 0.")
    occupied = _occupied_pixels(image, threshold, is_negated, mode)
    region = area_of_cells(occupied, np.array([x, y]), resolution)
    if yaw != 0.0:
        return OccupiedArea(_turned(region, x, y, yaw), None)
    n_rows, n_columns = occupied.shape
    return OccupiedArea(region, Window(x, y, x + n_columns * resolution, y + n_rows * resolution))


def _yaml_values(text: str) -> dict[str, list[str]]:
    """Return the values of ``key: value``, ``key: [a, b]`` and of lists below their key, all that such a file has."""
    values: dict[str, list[str]] = {}
    key = ""
    for line in text.splitlines():
        if entry := re.match(r"\s*-\s*([^#]+)", line):
            values.setdefault(key, []).append(_bare(entry[1]))
        elif pair := re.match(r"(\w+)\s*:\s*(\[[^\]]*\]|\"[^\"]*\"|'[^']*'|[^#]*)", line):
            key = pair[1]
            parts = pair[2].strip().strip("[]").split(",") if pair[2].startswith("[") else [pair[2]]
            values[key] = [_bare(part) for part in parts if part.strip()]
    return values


def _bare(word: str) -> str:
    return word.strip().strip("\"'")


def _occupied_pixels(image: Path, threshold: float, is_negated: bool, mode: str) -> NDArray[np.bool_]:
    """Return which cells of an image are occupied, row 0 with the lowest y."""
    if not image.is_file():
        raise InputError(f"{image}: no such file. The yaml file names it as the image of the map.")
    try:
        pixels = np.asarray(imread(image))
    except (OSError, ValueError, SyntaxError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{image}: not an image that can be read ({reason}).") from None
    shade = pixels[..., :3].mean(axis=-1) if pixels.ndim == 3 else pixels.astype(np.float64)
    # PNG comes as floats up to 1, everything else as it is.
    shade = shade if np.issubdtype(pixels.dtype, np.floating) else shade / np.iinfo(pixels.dtype).max
    if mode == "raw":
        value = 255.0 * shade / RAW_MOST
        return np.asarray((value > threshold) & (value <= 1.0))[::-1]
    return np.asarray((shade if is_negated else 1.0 - shade) > threshold)[::-1]


def _turned(region: shapely.Geometry, x: float, y: float, yaw: float) -> shapely.Geometry:
    """Return the region turned round its lower left corner."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, s], [-s, c]])
    return shapely.transform(region, lambda xy: (xy - [x, y]) @ turn + [x, y])
