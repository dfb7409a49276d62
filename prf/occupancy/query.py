"""What a grid says of points, squares and paths, taking its cells as independent, which is what a grid assumes."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from prf.occupancy.model import OccupancyGrid
from prf.shell.errors import InputError, UsageError

Floats = NDArray[np.float64]

ON_BORDER = 1e-9
"""Share of a cell within which a centre lies on the border of a square, which belongs to it."""


def occupied_probability(grid: OccupancyGrid, xy: ArrayLike, square: float = 0.0) -> Floats:
    """Return how probably each point, or the square round it, is occupied.

    Parameters
    ----------
    grid : OccupancyGrid
    xy : (n_points, 2) array
        Points in metres.
    square : float
        Side of the closed square in metres: one minus the product of 1 - p over the cells whose centres lie in it.
        Where there is none, as with 0, the cell of the point.

    Returns
    -------
    (n_points,) float64
        Probabilities; nan for a point outside the grid.

    Raises
    ------
    UsageError
        If `square` is negative or not finite.
    """
    if not 0.0 <= square < np.inf:
        raise UsageError(f"square {square} m: the side of a square is a finite number >= 0.")
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    inside = grid.window.contains(points)
    answers = np.full(len(points), np.nan)
    place = (points[inside] - grid.origin) / grid.resolution
    most = np.array(grid.occupancy.shape[::-1]) - 1
    own = np.minimum(place.astype(np.int64), most)
    reach = 0.5 * square / grid.resolution + ON_BORDER
    low = np.clip(np.ceil(place - 0.5 - reach), 0, most + 1).astype(np.int64)
    high = np.clip(np.floor(place - 0.5 + reach) + 1, 0, most + 1).astype(np.int64)
    several = (low < high).all(axis=1) & (square > 0.0)
    free = np.where(several, _log_free_sums(grid, low, high), 0.0)
    alone = grid.occupancy[own[:, 1], own[:, 0]]
    answers[inside] = np.where(several, -np.expm1(free), alone)
    return answers


def path_free(grid: OccupancyGrid, path_xy: ArrayLike, radius: float) -> float:
    """Return the probability that a disc can follow the whole path: the product of 1 - p over the cells it touches.

    Parameters
    ----------
    grid : OccupancyGrid
    path_xy : (n_points, 2) array
        Corners of the path in metres, in order.
    radius : float
        Radius of the disc in metres, >= 0.

    Returns
    -------
    float
        nan if a part of the path lies outside the grid.

    Raises
    ------
    InputError
        If the path has no point.
    UsageError
        If `radius` is negative or not finite.
    """
    path = np.asarray(path_xy, dtype=np.float64).reshape(-1, 2)
    if len(path) == 0:
        raise InputError("the path has no point.")
    if not 0.0 <= radius < np.inf:
        raise UsageError(f"radius {radius} m: the radius of a disc is a finite number >= 0.")
    if not grid.window.contains(path).all():
        return float("nan")
    most = np.array(grid.occupancy.shape[::-1])
    low = np.clip(np.floor((path.min(axis=0) - radius - grid.origin) / grid.resolution), 0, most - 1).astype(int)
    high = np.clip(np.ceil((path.max(axis=0) + radius - grid.origin) / grid.resolution), 1, most).astype(int)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    corner = grid.origin + grid.resolution * np.column_stack([columns.ravel(), rows.ravel()])
    boxes = shapely.box(corner[:, 0], corner[:, 1], *(corner + grid.resolution).T)
    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    shapely.prepare(line)
    touched = shapely.dwithin(boxes, line, radius)
    return float(np.exp(_log_free(grid)[rows.ravel()[touched], columns.ravel()[touched]].sum()))


def _log_free(grid: OccupancyGrid) -> Floats:
    """Return log(1 - p) of every cell, kept finite so that sums of many can be subtracted."""
    return np.log1p(-np.minimum(grid.occupancy.astype(np.float64), 1.0 - 1e-12))


def _log_free_sums(grid: OccupancyGrid, low: NDArray[np.int64], high: NDArray[np.int64]) -> Floats:
    """Return the sums of log(1 - p) over columns and rows from `low` up to before `high`, each (n, 2)."""
    table = np.zeros(np.array(grid.occupancy.shape) + 1)
    table[1:, 1:] = _log_free(grid).cumsum(axis=0).cumsum(axis=1)
    (x0, y0), (x1, y1) = low.T, high.T
    sums: Floats = table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0]
    return np.minimum(sums, 0.0)
