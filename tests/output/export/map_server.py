"""What ROS makes of a map's files, pixel by pixel: slow, and by the letter of its documentation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.image import imread


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


def read_png(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return shade (0 to 255) and opacity of each pixel, the top row first."""
    pixels = imread(path)
    assert pixels.shape[2] == 4
    return np.rint(255 * pixels[..., :3].mean(axis=2)).astype(int), np.rint(255 * pixels[..., 3]).astype(int)


def load(path: Path, ros: int = 2) -> Served:
    """Serve the map of a yaml file as map_server of ROS 1 or nav2 does."""
    content = read_yaml(path)
    image = path.parent / content["image"].strip('"')
    shade, opacity = read_png(image) if image.suffix == ".png" else (read_pgm(image).astype(int), None)
    assert content["negate"] == "0"
    free, occupied = float(content["free_thresh"]), float(content["occupied_thresh"])
    height, width = shade.shape
    data = np.empty((height, width), int)
    for y in range(height):
        for x in range(width):
            clear = opacity is not None and opacity[y, x] < 255
            data[height - y - 1, x] = serve(int(shade[y, x]), clear, content["mode"], free, occupied, ros)
    origin = [float(part) for part in content["origin"].strip("[]").split(",")]
    return Served(data, float(content["resolution"]), origin)


def serve(shade: int, is_clear: bool, mode: str, free: float, occupied: float, ros: int) -> int:
    """Return what a pixel is served as, -1 if unknown; `is_clear`: whether one sees through it."""
    occ = (255 - shade) / 255.0
    if mode == "raw" and ros == 1:
        return shade - 256 if shade > 127 else shade  # a byte with a sign
    if mode == "raw":
        return shade if shade <= 100 else -1
    if mode == "scale" and ros == 2 and is_clear:
        return -1
    if occ > occupied:
        return 100
    if occ < free:
        return 0
    if mode == "trinary" or is_clear:
        return -1
    part = (occ - free) / (occupied - free)
    return int(99 * part) if ros == 1 else round(100 * part)
