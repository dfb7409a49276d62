"""What ROS makes of a map's files, pixel by pixel: slow, and by the letter of its documentation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np


class Served(NamedTuple):
    """An OccupancyGrid: data (height, width) of -1 and 0 ... 100, row 0 has the lowest y."""

    data: np.ndarray
    resolution: float
    origin: list[float]


def read_yaml(path: Path) -> dict[str, str]:
    return {key: value.strip() for key, _, value in (line.partition(":") for line in path.read_text().splitlines())}


def read_pgm(path: Path) -> np.ndarray:
    """Return the shade of each pixel, 0 to 255, the top row first."""
    magic, size, most, pixels = path.read_bytes().split(b"\n", 3)
    assert (magic, most) == (b"P5", b"255")
    width, height = map(int, size.split())
    grey = np.frombuffer(pixels, np.uint8)
    assert len(grey) == width * height
    return grey.reshape(height, width)


def load(path: Path) -> Served:
    """Serve the map of a yaml file as map_server of ROS 1 and nav2 do in mode trinary."""
    content = read_yaml(path)
    shade = read_pgm(path.parent / content["image"].strip('"'))
    assert (content["negate"], content["mode"]) == ("0", "trinary")
    free, occupied = float(content["free_thresh"]), float(content["occupied_thresh"])
    height, width = shade.shape
    data = np.empty((height, width), int)
    for y in range(height):
        for x in range(width):
            occ = (255 - int(shade[y, x])) / 255.0
            data[height - y - 1, x] = 100 if occ > occupied else 0 if occ < free else -1
    origin = [float(part) for part in content["origin"].strip("[]").split(",")]
    return Served(data, float(content["resolution"]), origin)
