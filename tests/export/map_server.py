"""What ROS makes of a map's files, pixel by pixel: slow, and by the letter of its documentation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image


class Served(NamedTuple):
    """An OccupancyGrid: data (height, width) of -1 and 0 ... 100, row 0 has the lowest y."""

    data: np.ndarray
    resolution: float
    origin: list[float]


def read_yaml(path: Path) -> dict[str, str]:
    return {key: value.strip() for key, _, value in (line.partition(":") for line in path.read_text().splitlines())}


def read_pgm(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return shade and opacity of each pixel, 0 to 255, the top row first."""
    magic, size, most, pixels = path.read_bytes().split(b"\n", 3)
    assert (magic, most) == (b"P5", b"255")
    width, height = map(int, size.split())
    grey = np.frombuffer(pixels, np.uint8)
    assert len(grey) == width * height
    return grey.reshape(height, width), np.full((height, width), 255, np.uint8)


def read_png(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return shade and opacity of an RGBA image: ROS 1 loses the transparency of grey ones."""
    with Image.open(path) as image:
        image.verify()
    with Image.open(path) as image:
        assert image.mode == "RGBA"
        pixels = np.asarray(image)
    assert (pixels[..., :1] == pixels[..., :3]).all()
    return pixels[..., 0], pixels[..., 3]


def load(path: Path, ros: int = 2) -> Served:
    """Serve the map of a yaml file as nav2's map_server does, or that of ROS 1."""
    content = read_yaml(path)
    image = path.parent / content["image"].strip('"')
    shade, opacity = (read_png if image.suffix == ".png" else read_pgm)(image)
    assert content["negate"] == "0"
    free, occupied = float(content["free_thresh"]), float(content["occupied_thresh"])
    cell = nav2_cell if ros == 2 else ros1_cell
    height, width = shade.shape
    data = np.empty((height, width), int)
    for y in range(height):
        for x in range(width):
            value = cell(int(shade[y, x]), int(opacity[y, x]), content["mode"], free, occupied)
            data[height - y - 1, x] = value
    origin = [float(part) for part in content["origin"].strip("[]").split(",")]
    return Served(data, float(content["resolution"]), origin)


def nav2_cell(pixel: int, opacity: int, mode: str, free: float, occupied: float) -> int:
    if mode == "raw":
        return pixel if pixel <= 100 else -1
    occ = 1.0 - pixel / 255.0
    if mode == "scale" and opacity < 255:
        return -1
    if occ > occupied:
        return 100
    if occ < free:
        return 0
    return -1 if mode == "trinary" else int(np.rint(100.0 * (occ - free) / (occupied - free)))


def ros1_cell(pixel: int, opacity: int, mode: str, free: float, occupied: float) -> int:
    """The image is looked at before the transparency, and a raw value is a signed byte."""
    if mode == "raw":
        return pixel if pixel < 128 else pixel - 256
    occ = (255 - pixel) / 255.0
    if occ > occupied:
        return 100
    if occ < free:
        return 0
    return -1 if mode == "trinary" or opacity < 1 else int(99 * (occ - free) / (occupied - free))
