"""Worlds from elsewhere: maps in files, and draws from the prior."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from prf.arak import exact_draws
from prf.score import read_occupied_area
from prf.shell.errors import ConfigError, InputError
from prf.simulate.rasters import read_cell_map, world_of_cells
from prf.simulate.world import World
from prf.window import Window

YAML_SUFFIXES = (".yaml", ".yml")
MARGIN = 1.0
"""Metres of free space round polygons that come without a window."""
MOST_DRAWS = 1000


class DrawnWorld(NamedTuple):
    """A world drawn from the prior, and how many draws went before it."""

    world: World
    n_redrawn: int


def read_world(path: str | os.PathLike[str], unknown_is_occupied: bool = False) -> World:
    """Read a world from GeoJSON polygons of occupied area, or from the yaml file of a ROS map.

    Parameters
    ----------
    path : path
        GeoJSON of any program, in metres; a property ``window`` is kept.
    unknown_is_occupied : bool
        What unknown cells of a ROS map become, and what lies round it.

    Raises
    ------
    InputError
        If it cannot be read, or its walls have no inside and outside: polygons that touch at a point; or if a ROS map
        is turned against the axes.
    """
    if Path(path).suffix.lower() in YAML_SUFFIXES:
        cells = read_cell_map(path)
        if cells.yaw != 0.0:
            raise InputError(f"{path}: origin has the yaw {cells.yaw:g}. A turned map is no world: turn it back first.")
        return world_of_cells(cells, unknown_is_occupied)
    area = read_occupied_area(path)
    if area.window is None and area.region.is_empty:
        raise InputError(f"{path}: neither a polygon nor a window. Give polygons of the occupied area.")
    window = area.window or Window.beyond(area.region.bounds, MARGIN)
    try:
        return World.from_polygons(area.region, window)
    except InputError as error:
        raise InputError(f"{path}: {error}. Part polygons that touch at a point.") from error


def draw_world(scale: float, window: Window, rng: np.random.Generator, accept: Callable[[World], bool]) -> DrawnWorld:
    """Draw from the Arak process until a draw can be used.

    Parameters
    ----------
    scale : float
        p in 1/m.
    window : Window
    rng : numpy.random.Generator
    accept : callable
        Whether a world can be used. The world that comes back is a draw from the prior given that it can.

    Raises
    ------
    ConfigError
        If none of `MOST_DRAWS` draws can.
    """
    for n_redrawn in range(MOST_DRAWS):
        world = World.from_coloring(exact_draws(scale, window, 1, rng)[0])
        if accept(world):
            return DrawnWorld(world, n_redrawn)
    raise ConfigError(
        f"scale {scale:g}: none of {MOST_DRAWS} draws leaves enough free space. Take a smaller scale, or another size."
    )
