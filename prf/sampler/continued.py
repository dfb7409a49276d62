"""Where chains start that go on from a run: its last maps, and what readings show of ground that it did not see."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from prf.kernels.state.grid import make_grid
from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.ranges import unit_vectors, window_exit
from prf.model.walls import map_of_walls, walls_of
from prf.model.window import Window
from prf.readings import Readings
from prf.readings.ground import count_beams
from prf.readings.way import cleared
from prf.results import PosteriorImage
from prf.results.geojson import area_of_cells
from prf.results.score.scene import first_edges
from prf.sampler.lines import allowed
from prf.sampler.starts import CELL, CLEAR, MOST_CELLS, map_of_region, occupied_region
from prf.sampler.target import Target, white_places
from prf.shell.errors import InputError

PASSED_CELL = 0.1
"""Side of the cells, metres, in which beams are counted that pass ground which a run had not seen."""


class Earlier(NamedTuple):
    """What a chain that goes on from a run starts from (:mod:`prf.sampler.extend`)."""

    coloring: Coloring  # the last map of a chain of that run
    image: PosteriorImage  # with the ground that it saw, or nearly so


def continued_map(earlier: Earlier, target: Target) -> Coloring:
    """Return the map of a run with what beams show of ground that it did not see, every sensor in white.

    There the contour of their returns is added, and what they pass is cut out. What contradicts the run where it saw
    the ground is left to the chain. Walls that it saw stay what they were, to the last bit. A map of walls is gone on
    from as it is, without those that cover a sensor: births find the others.
    """
    before, window = earlier.coloring, target.window
    if target.walls is not None:
        return map_of_walls(allowed(walls_of(before), target), window)
    region = occupied_polygons(before)
    if target.laser is not None:
        readings = _up_to_known_walls(target.laser.readings.within(target.laser.model.limit), before, earlier.image)
        ends = readings.origin + np.where(readings.returned, readings.range, 0.0)[:, None] * unit_vectors(
            readings.angle
        )
        lies_apart = readings.returned & ~earlier.image.seen_at(ends)
        region = shapely.difference(region, _passed_region(window, readings, earlier.image))
        if lies_apart.any():
            cell = max(CELL, target.laser.model.noise, float(np.sqrt(window.area / MOST_CELLS)))
            region = shapely.union(region, occupied_region(window, target.laser, lies_apart, cell))
    places = np.unique(white_places(target), axis=0)
    shapely.prepare(region)
    covered = places[shapely.intersects_xy(region, *places.T)]
    region = shapely.difference(
        region, shapely.union_all(shapely.buffer(shapely.points(covered), CLEAR * CELL, quad_segs=2))
    )
    region = shapely.difference(region, cleared(target.way, target.driven_radius))
    try:
        return from_polygons(region, window)
    except InputError:  # parts that touch in a point
        return map_of_region(region, target)


def _up_to_known_walls(readings: Readings, before: Coloring, image: PosteriorImage) -> Readings:
    """Return readings that end at the walls of a map at the latest, where these stand in ground that was seen.

    What goes on behind them is a beam that the wall did not return.
    """
    inside = before.window.contains(readings.origin, strictly=True)
    direction = unit_vectors(readings.angle)
    rays = np.column_stack([readings.origin, direction, np.full(readings.n_beams, readings.max_range)])[inside]
    rays[:, 4] = np.minimum(rays[:, 4], window_exit(before.window, rays[:, :2], rays[:, 2:4]))
    wall = np.full(readings.n_beams, np.inf)
    wall[inside] = first_edges(np.ascontiguousarray(rays), before.segments(), before.window)
    met = np.isfinite(wall)
    met[met] = image.seen_at(readings.origin[met] + wall[met, None] * direction[met])
    return dataclasses.replace(readings, range=np.where(met, np.minimum(readings.range, wall), readings.range))


def _passed_region(window: Window, readings: Readings, image: PosteriorImage) -> BaseGeometry:
    """Return the ground that these readings pass and where none ends, and that an image has as not seen."""
    grid = make_grid(*window, max(PASSED_CELL, float(np.sqrt(window.area / MOST_CELLS))))
    found = count_beams(grid, window, readings.origin, readings.angle, readings.range, readings.max_range)
    passes, hits = (each.reshape(grid.ny, grid.nx) for each in found[:2])
    free = (passes > 0) & (hits == 0)
    row, column = np.nonzero(free)
    centres = np.column_stack([grid.x0 + (column + 0.5) * grid.cell, grid.y0 + (row + 0.5) * grid.cell])
    free[row, column] = ~image.seen_at(centres)
    return area_of_cells(free, np.array([grid.x0, grid.y0]), grid.cell)
