"""Colours of a map of walls: how many walls cover a pixel or a point, which is black if one does.

The counts are kept where the Arak process keeps colours, 0 or 1. Sensors are never in black.
"""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.points import BLACK, FIRST, GAIN, HIGHEST, LOWEST, Points, X, Y, first_not_below
from prf.kernels.state.geometry import loop_box
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import axis_index
from prf.kernels.state.image import Image, first_centre, row_crossings, settle
from prf.kernels.walls.shape import is_inside, wall_of, write_corners
from prf.kernels.walls.table import N_NEW, N_OLD, Walls, wall_in


@core
def cover_image(image: Image, loop: Array, change: int, step: int) -> None:
    """Count a wall with corners `loop` (4, 2) that comes (1) or goes (-1) at the pixels whose centre it covers."""
    grid = image.grid
    _, y_min, _, y_max = loop_box(loop, 4)
    k0 = axis_index((y_min - grid.y0) / grid.cell, grid.ny)
    k1 = axis_index((y_max - grid.y0) / grid.cell, grid.ny)
    for k in range(k0, k1 + 1):
        found = row_crossings(image.crossings, loop, 4, grid.y0 + (k + 0.5) * grid.cell)
        for pair in range(0, found - 1, 2):
            for i in range(first_centre(grid, image.crossings[pair]), first_centre(grid, image.crossings[pair + 1])):
                settle(image, i + grid.nx * k, step)
                image.black[i + grid.nx * k] = int(image.black[i + grid.nx * k]) + change


@core
def cover_point(points: Points, walls: Walls, k: int, keeps: bool) -> float:
    """Gain of a point by a proposal of walls; its count is kept if `keeps`."""
    x, y, before = points.column[X, k], points.column[Y, k], points.column[BLACK, k]
    after = before
    for i in range(walls.counts[N_OLD]):
        after -= 1.0 if is_inside(wall_in(walls.row, walls.old[i]), x, y, 0.0) else 0.0
    for i in range(walls.counts[N_NEW]):
        after += 1.0 if is_inside(wall_in(walls.new, i), x, y, 0.0) else 0.0
    turns = (before > 0.0) != (after > 0.0)
    gain = points.column[GAIN, k] if turns else 0.0
    if keeps:
        points.column[BLACK, k] = after
        if turns:
            points.column[GAIN, k] = -points.column[GAIN, k]
    return gain


@core
def cover_points(points: Points, walls: Walls, keeps: bool) -> float:
    """Change of the log likelihood of points by a proposal of walls, before rows change; it is kept if `keeps`."""
    x_min, y_min, x_max, y_max = np.inf, np.inf, -np.inf, -np.inf
    for i in range(walls.counts[N_OLD] + walls.counts[N_NEW]):
        is_old = i < walls.counts[N_OLD]
        wall = wall_in(walls.row, walls.old[i]) if is_old else wall_in(walls.new, i - walls.counts[N_OLD])
        x_min, x_max = min(x_min, min(wall[0], wall[2]) - wall[4]), max(x_max, max(wall[0], wall[2]) + wall[4])
        y_min, y_max = min(y_min, min(wall[1], wall[3]) - wall[4]), max(y_max, max(wall[1], wall[3]) + wall[4])
    change, n_bands = 0.0, points.band.shape[1] - 1
    band = first_not_below(points.band[HIGHEST], 0, n_bands, y_min)
    while band < n_bands and points.band[LOWEST, band] <= y_max:
        end = int(points.band[FIRST, band + 1])
        k = first_not_below(points.column[X], int(points.band[FIRST, band]), end, x_min)
        while k < end and points.column[X, k] <= x_max:
            change += cover_point(points, walls, k, keeps)
            k += 1
        band += 1
    return change


@core_entry
def cover_all(graph: Graph, image: Image, points: Points, loop: Array, black: Array, sites: Array) -> None:
    """Count the walls over every pixel, point and site (n, 2) from nothing; times must be settled.

    `loop` (4, 2) is scratch; `black` (n,) takes 1 for each site in a wall.
    """
    step = graph.counts[c.STEP]
    image.black[:] = 0
    for i in range(graph.counts[c.WALLS]):
        if image.black.size > 0:
            write_corners(graph, graph.members[c.WALLS, i], loop)
            cover_image(image, loop, 1, step)
    for k in range(points.column.shape[1]):
        was_black, count = points.column[BLACK, k] > 0.0, 0.0
        for i in range(graph.counts[c.WALLS]):
            wall = wall_of(graph, graph.members[c.WALLS, i])
            count += 1.0 if is_inside(wall, points.column[X, k], points.column[Y, k], 0.0) else 0.0
        points.column[BLACK, k] = count
        if was_black != (count > 0.0):
            points.column[GAIN, k] = -points.column[GAIN, k]
    for k in range(sites.shape[0]):
        black[k] = 0
        for i in range(graph.counts[c.WALLS]):
            if is_inside(wall_of(graph, graph.members[c.WALLS, i]), sites[k, 0], sites[k, 1], 0.0):
                black[k] = 1
