"""Occupancy for ROS: image and yaml file as map_server (ROS 1 and nav2) reads them, in mode trinary.

What map_server makes of a pixel (https://wiki.ros.org/map_server, section "Value Interpretation"), ``negate`` 0 and
occ = (255 - pixel) / 255: 100 above ``occupied_thresh``, 0 below ``free_thresh``, else unknown (-1).
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.output.export.cells import Raster

FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
"""Those of ROS 1. A free threshold of 0.25, nav2's own, would make unknown cells free: pixel 205 means 0.1961."""
FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0


class RosMap(NamedTuple):
    """Content of the two files, and numbers of cells of each kind."""

    yaml: str
    image: bytes
    counts: dict[str, int]


def ros_map(cells: Raster, unknown: tuple[float, float] | None, image_name: str) -> RosMap:
    """Return the files of a map.

    `unknown`: a cell of a probability from the first to the second is unknown, as is one of probability nan. None: the
    thresholds. `image_name`: name of the image as the yaml file gives it, relative to itself.
    """
    probability = np.asarray(cells.probability, dtype=np.float64)[::-1]  # the top row of an image has the largest y
    low, high = unknown if unknown is not None else (FREE_THRESHOLD, OCCUPIED_THRESHOLD)
    is_free, is_occupied = probability < low, probability > high
    pixel = np.select([is_occupied, is_free], [OCCUPIED_PIXEL, FREE_PIXEL], UNKNOWN_PIXEL).astype(np.uint8)
    kinds = {"n_free": is_free, "n_occupied": is_occupied, "n_unknown": ~(is_free | is_occupied)}
    counts = {name: int(np.count_nonzero(kind)) for name, kind in kinds.items()}
    return RosMap(_yaml(cells, image_name), pgm_bytes(pixel), counts)


def _yaml(cells: Raster, image_name: str) -> str:
    x, y = (_number(value) for value in cells.origin)
    lines = (
        f"image: {_plain(image_name)}",
        "mode: trinary",
        f"resolution: {_number(cells.resolution)}",
        f"origin: [{x}, {y}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {OCCUPIED_THRESHOLD}",
        f"free_thresh: {FREE_THRESHOLD}",
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
