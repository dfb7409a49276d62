"""The known map: GeoJSON of whatever program, or the yaml file and image of a map for ROS."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import shapely

from prf.score import OccupiedArea, read_occupied_area
from prf.score.polygons import area_of_cells
from prf.shell.errors import InputError
from prf.simulate.rasters import read_cell_map
from prf.simulate.sources import YAML_SUFFIXES


def read_known_map(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read the occupied area of a map file, chosen by its name: .yaml and .yml are for ROS, others are GeoJSON.

    Raises
    ------
    InputError
        If it is missing, damaged, or has nothing occupied.
    """
    is_ros = Path(path).suffix.lower() in YAML_SUFFIXES
    area = read_ros_map(path) if is_ros else read_occupied_area(path)
    if area.region.is_empty:
        raise InputError(f"{path}: nothing is occupied in this map. Calibration needs walls.")
    return area


def read_ros_map(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read a map for ROS: occupied pixels are occupied, all others free, staircases straightened.

    Parameters
    ----------
    path : path
        The yaml file; the image stands where it says.

    Returns
    -------
    OccupiedArea
        Without a window if the map is turned (its origin has a yaw).

    Raises
    ------
    InputError
        If a file is missing or damaged, or a value is none.
    """
    cells = read_cell_map(path)
    region = area_of_cells(cells.occupied, np.array(cells.origin), cells.resolution)
    if cells.yaw != 0.0:
        return OccupiedArea(_turned(region, *cells.origin, cells.yaw), None)
    return OccupiedArea(region, cells.window())


def _turned(region: shapely.Geometry, x: float, y: float, yaw: float) -> shapely.Geometry:
    """Return the region turned round its lower left corner."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, s], [-s, c]])
    return shapely.transform(region, lambda xy: (xy - [x, y]) @ turn + [x, y])
