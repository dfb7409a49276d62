"""What ROS makes of a map's files, pixel by pixel: slow, and by the letter of its documentation."""

from __future__ import annotations

import struct
import zlib
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


def read_pgm(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return shade and opacity of each pixel, 0 to 255, the top row first."""
    magic, size, most, pixels = path.read_bytes().split(b"\n", 3)
    assert (magic, most) == (b"P5", b"255")
    width, height = map(int, size.split())
    grey = np.frombuffer(pixels, np.uint8)
    assert len(grey) == width * height
    return grey.reshape(height, width), np.full((height, width), 255, np.uint8)


def read_png(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return shade and opacity of an RGBA image without filters, checking every checksum."""
    content = path.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    chunks, at = {}, 8
    while at < len(content):
        (length,) = struct.unpack(">I", content[at : at + 4])
        kind, body = content[at + 4 : at + 8], content[at + 8 : at + 8 + length]
        assert struct.unpack(">I", content[at + 8 + length : at + 12 + length]) == (zlib.crc32(kind + body),)
        chunks[kind] = body
        at += 12 + length
    width, height, depth, colour, *_ = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert (depth, colour) == (8, 6)
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, 1 + 4 * width)
    assert not rows[:, 0].any()
    pixels = rows[:, 1:].reshape(height, width, 4)
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
