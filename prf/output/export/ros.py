"""Maps for ROS: an image and a yaml file for map_server, and the parameters by which Nav2 loads them.

What map_server of ROS 1 and nav2 make of a pixel of shade s from 0 to 1, with ``negate`` 0 and occ = 1 - s:

========= ========================================================================================
trinary   100 above ``occupied_thresh``, 0 below ``free_thresh``, else unknown (-1)
scale     the same thresholds, between them 100 (occ - free) / (occupied - free) (ROS 1: 99 times, cut
          off), unknown where the pixel is transparent
raw       255 s as it is; nav2: above 100 unknown, ROS 1: the byte of -1 (255)
========= ========================================================================================

Sources: https://wiki.ros.org/map_server, "Value Interpretation", and the documentation of nav2_map_server.
"""

from __future__ import annotations

import json
import os
import re
import struct
import zlib
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from prf.output.export.cells import Raster

Mode = Literal["trinary", "scale", "raw"]
MODES: tuple[Mode, ...] = ("trinary", "scale", "raw")

FREE_THRESHOLD, OCCUPIED_THRESHOLD = 0.196, 0.65
"""Those of ROS 1. A free threshold of 0.25, nav2's own, would make unknown cells free: pixel 205 means 0.1961."""
FREE_PIXEL, UNKNOWN_PIXEL, OCCUPIED_PIXEL = 254, 205, 0
RAW_UNKNOWN = 255
LETHAL = 65
"""Percent from which a costmap takes a cell of a map in percent for an obstacle: the threshold of mode trinary."""


def ros_map(
    cells: Raster, unknown: tuple[float, float] | None, image_name: str, mode: Mode = "trinary"
) -> tuple[str, bytes, dict[str, int]]:
    """Return the yaml file and the image of a map for ROS, and the numbers of cells of each kind.

    `unknown`: of mode trinary, a cell of a probability from the first to the second is unknown, as is one of
    probability nan in all modes. None: the thresholds. `image_name`: name of the image as the yaml file gives it,
    relative to itself. `mode`: trinary is free, occupied or unknown; scale and raw serve the probability in percent.
    """
    probability = np.asarray(cells.probability, dtype=np.float64)[::-1]  # the top row of an image has the largest y
    if mode != "trinary":
        return _in_percent(probability, cells, image_name, mode)
    low, high = unknown if unknown is not None else (FREE_THRESHOLD, OCCUPIED_THRESHOLD)
    is_free, is_occupied = probability < low, probability > high
    pixel = np.select([is_occupied, is_free], [OCCUPIED_PIXEL, FREE_PIXEL], UNKNOWN_PIXEL).astype(np.uint8)
    kinds = {"n_free": is_free, "n_occupied": is_occupied, "n_unknown": ~(is_free | is_occupied)}
    counts = {name: int(np.count_nonzero(kind)) for name, kind in kinds.items()}
    yaml = _yaml(cells, image_name, mode, (FREE_THRESHOLD, OCCUPIED_THRESHOLD))
    return yaml, pgm_bytes(pixel), counts


def _in_percent(
    probability: NDArray[np.float64], cells: Raster, image_name: str, mode: Mode
) -> tuple[str, bytes, dict[str, int]]:
    """Return a map that is served as whole percent of the probability."""
    known = np.isfinite(probability)
    percent = np.rint(100.0 * np.where(known, probability, 0.0))
    counts = {"n_known": int(np.count_nonzero(known)), "n_unknown": int(np.count_nonzero(~known))}
    yaml = _yaml(cells, image_name, mode, (0.0, 1.0))
    if mode == "raw":
        return yaml, pgm_bytes(np.where(known, percent, RAW_UNKNOWN).astype(np.uint8)), counts
    grey = (255 - np.rint(2.55 * percent)).astype(np.uint8)
    return yaml, png_bytes(np.stack([grey, grey, grey, 255 * known.astype(np.uint8)], axis=-1)), counts


def _yaml(cells: Raster, image_name: str, mode: Mode, thresholds: tuple[float, float]) -> str:
    x, y = (_number(value) for value in cells.origin)
    lines = (
        f"image: {_plain(image_name)}",
        f"mode: {mode}",
        f"resolution: {_number(cells.resolution)}",
        f"origin: [{x}, {y}, 0.0]",
        "negate: 0",
        f"occupied_thresh: {thresholds[1]}",
        f"free_thresh: {thresholds[0]}",
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


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """Return a PNG of (n_rows, n_columns, 4) red, green, blue and opacity, the top row first."""
    n_rows, n_columns, _ = pixels.shape
    rows = np.concatenate([np.zeros((n_rows, 1), np.uint8), pixels.reshape(n_rows, -1)], axis=1)  # filter 0: as it is
    head = struct.pack(">IIBBBBB", n_columns, n_rows, 8, 6, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b""))
    chunks = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def nav2_parameters(yaml_file: str, mode: Mode, is_mask: bool, radius: float) -> str:
    """Return parameters by which Nav2 loads a map, or a mask of where not to go, to be merged into those of a robot.

    `yaml_file`: named by its absolute path, since map_server looks from where it was started. `radius`: metres by which
    the map is inflated already; 0: not.
    """
    name = json.dumps(os.path.abspath(yaml_file), ensure_ascii=False)
    if is_mask:
        return _text(MERGED, MASK.format(name=name))
    costs = SCALED if mode != "trinary" else TRINARY
    inflated = [INFLATED.format(radius=radius)] if radius > 0.0 else []
    return _text(MERGED, SERVER.format(name=name), *inflated, "global_costmap:", costs)


def _text(*parts: str) -> str:
    return "\n".join(part.strip("\n") for part in parts) + "\n"


MERGED = "# To be merged into the robot's parameters (params_file of Nav2): by itself it starts nothing."
SERVER = """
map_server:
  ros__parameters:
    yaml_filename: {name}  # where it was written
"""
INFLATED = "# The map is inflated by {radius:g} m already: let the inflation_layer add a margin alone."
TRINARY = """
  global_costmap:
    ros__parameters:
      track_unknown_space: true  # what no reading saw stays unknown; else it would be free
      static_layer:
        plugin: nav2_costmap_2d::StaticLayer
        map_subscribe_transient_local: true
"""
SCALED = f"""
  global_costmap:
    ros__parameters:
      track_unknown_space: true  # what no reading saw stays unknown; else it would be free
      trinary_costmap: false  # costs rise with the probability, in percent
      lethal_cost_threshold: {LETHAL}  # percent from which on a cell is an obstacle
      static_layer:
        plugin: nav2_costmap_2d::StaticLayer
        map_subscribe_transient_local: true
"""
MASK = """
filter_mask_server:  # a second map_server
  ros__parameters:
    yaml_filename: {name}  # where it was written
    topic_name: keepout_filter_mask
costmap_filter_info_server:
  ros__parameters:
    type: 0
    filter_info_topic: costmap_filter_info
    mask_topic: keepout_filter_mask
    base: 0.0
    multiplier: 1.0
global_costmap:
  global_costmap:
    ros__parameters:
      filters: [keepout_filter]
      keepout_filter:
        plugin: nav2_costmap_2d::KeepoutFilter
        enabled: true
        filter_info_topic: costmap_filter_info
"""
