"""Occupancy for ROS: image and yaml file as map_server (ROS 1 and nav2) reads them.

What map_server makes of a pixel (https://wiki.ros.org/map_server, section "Value Interpretation"), ``negate`` 0 and
occ = (255 - pixel) / 255: mode trinary gives 100 above ``occupied_thresh``, 0 below ``free_thresh``, else unknown (-1);
mode scale interpolates between the thresholds and takes transparent pixels as unknown; mode raw takes the pixel itself
and, above 100, unknown.
"""

from __future__ import annotations

import io
import json
import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.export.cells import Cells

TRINARY, SCALE, RAW = "trinary", "scale", "raw"
IMAGE_SUFFIX = {TRINARY: ".pgm", SCALE: ".png", RAW: ".pgm"}
"""In mode scale an unknown cell is a transparent pixel, which PGM does not have; map_saver writes PNG likewise."""
FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
"""Those of ROS 1. A free threshold of 0.25, nav2's own, would make unknown cells free: pixel 205 means 0.1961."""
FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0
TRANSPARENT_PIXEL = 128
"""Between all thresholds, as ROS 1 looks at the transparency there only."""
RAW_UNKNOWN = 255
THRESHOLDS = {
    TRINARY: (FREE_THRESHOLD, OCCUPIED_THRESHOLD),
    SCALE: (0.0, 1.0),
    RAW: (FREE_THRESHOLD, OCCUPIED_THRESHOLD),
}
"""With 0 and 1 map_server serves every probability in mode scale; in mode raw it reads the thresholds without use."""


class RosMap(NamedTuple):
    """Content of the two files; numbers of cells of each kind, which in mode scale and raw is unknown alone."""

    yaml: str
    image: bytes
    counts: dict[str, int]


def ros_map(cells: Cells, mode: str, unknown: tuple[float, float] | None, image_name: str) -> RosMap:
    """Return the files of a map.

    Parameters
    ----------
    mode : str
        "trinary", "scale" or "raw".
    unknown : (float, float) or None
        A cell of a probability from the first to the second is unknown, as is one of probability nan. None: in mode
        trinary the thresholds, in the others no cell, since there 0.5 itself means that nothing is known.
    image_name : str
        Name of the image as the yaml file gives it, relative to itself.
    """
    probability = np.asarray(cells.probability, dtype=np.float64)[::-1]  # the top row of an image has the largest y
    low, high = unknown if unknown is not None else (FREE_THRESHOLD, OCCUPIED_THRESHOLD)
    is_free, is_occupied = probability < low, probability > high
    banded = mode == TRINARY or unknown is not None
    is_unknown = ~(is_free | is_occupied) if banded else np.isnan(probability)
    image = _image(probability, is_unknown, mode, high)
    kinds = {"n_free": is_free, "n_occupied": is_occupied} if mode == TRINARY else {}
    counts = {name: int(np.count_nonzero(kind)) for name, kind in {**kinds, "n_unknown": is_unknown}.items()}
    return RosMap(_yaml(cells, mode, image_name), image, counts)


def _image(probability: NDArray[Any], is_unknown: NDArray[np.bool_], mode: str, high: float) -> bytes:
    known = np.where(is_unknown, 0.0, probability)
    if mode == TRINARY:
        pixel = np.where(known > high, OCCUPIED_PIXEL, FREE_PIXEL)
        return pgm_bytes(np.where(is_unknown, UNKNOWN_PIXEL, pixel).astype(np.uint8))
    if mode == RAW:
        return pgm_bytes(np.where(is_unknown, RAW_UNKNOWN, np.rint(100.0 * known)).astype(np.uint8))
    pixel = 255.0 - np.rint(255.0 * known)
    return png_bytes(np.where(is_unknown, TRANSPARENT_PIXEL, pixel).astype(np.uint8), ~is_unknown)


def _yaml(cells: Cells, mode: str, image_name: str) -> str:
    free, occupied = THRESHOLDS[mode]
    x, y = (_number(value) for value in cells.origin)
    lines = (
        f"image: {_plain(image_name)}",
        f"mode: {mode}",
        f"resolution: {_number(cells.resolution)}",
        f"origin: [{x}, {y}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {_number(occupied)}",
        f"free_thresh: {_number(free)}",
    )
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return all digits without an exponent: to some readers of YAML 1e-05 is a text."""
    return np.format_float_positional(float(value), trim="0")


def _plain(name: str) -> str:
    """Return a name, quoted where YAML would take it for something else."""
    return name if re.fullmatch(r"[A-Za-z_][\w.-]*", name, re.ASCII) else json.dumps(name, ensure_ascii=False)


def pgm_bytes(grey: NDArray[np.uint8]) -> bytes:
    """Return a binary PGM of (n_rows, n_columns) pixels, the top row first."""
    n_rows, n_columns = grey.shape
    return b"P5\n%d %d\n255\n" % (n_columns, n_rows) + np.ascontiguousarray(grey).tobytes()


def png_bytes(grey: NDArray[np.uint8], opaque: NDArray[np.bool_]) -> bytes:
    """Return a PNG of (n_rows, n_columns) pixels, the top row first, transparent where not `opaque`.

    In colour with transparency: map_server's reader loses that of grey images.
    """
    from PIL import Image  # noqa: PLC0415 - matplotlib brings it, and only this mode needs it

    alpha = np.where(opaque, 255, 0).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(np.stack([grey, grey, grey, alpha], axis=-1)).save(stream, "PNG")
    return stream.getvalue()
