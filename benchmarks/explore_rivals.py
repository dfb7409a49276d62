"""How robots usually choose where to look next, on an occupancy grid: the nearest frontier, and mutual information.

Both are given the grid that `prf grid` builds of the same readings.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from prf.configuration import Configuration
from prf.readings import Readings
from prf.results.occupancy import OccupancyGrid, build_grid

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEAST_FRONTIER = 8
"""Cells of a frontier that is not noise."""
FREE = 0.35
"""Probability below which a cell is free."""
CLOSED = 2
"""Cells between beams that are no frontier are twice as wide at most."""
AT_FRONTIER = 0.4
"""Metres from a frontier at which a robot is there."""
N_BEAMS = 120
NEIGHBOURS = tuple((i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0))


class Goal(NamedTuple):
    """Where to go, and the way (k, 2), metres."""

    way: Floats
    metres: float


def grid_of(
    readings: Readings, window: tuple[float, ...], max_range: float, resolution: float, method: str
) -> OccupancyGrid:
    """Return what `prf grid` makes of readings."""
    config = Configuration.of(window=window, max_range=max_range)
    chosen = config.model_copy(update={"grid": config.grid.replace(resolution=resolution, method=method)})
    return build_grid(readings, None, chosen)[0]


def nearest_frontier(grid: OccupancyGrid, start: Floats, radius: float, tried: list[Floats]) -> Goal | None:
    """Return the nearest place beside a frontier, free cells at unknown ones; None if none is left that can be reached.

    `tried`: ends of ways that brought nothing.
    """
    seen = seen_closed(grid)
    taken = grid.seen & (grid.occupancy >= FREE)
    free, unknown = seen & ~taken, ~seen
    edge = free & ndimage.binary_dilation(unknown)
    label, n = ndimage.label(edge, np.ones((3, 3)))
    sizes = np.bincount(label.ravel())
    edge = edge & (sizes[label] >= LEAST_FRONTIER)
    if n == 0 or not edge.any():
        return None
    to_edge = ndimage.distance_transform_edt(~edge) * grid.resolution
    clear = ndimage.distance_transform_edt(~taken) * grid.resolution > radius + grid.resolution
    open_ = clear & free
    begin = cell_at(grid, start)
    open_[begin] = True
    goals = to_edge <= AT_FRONTIER
    for place in tried:
        row, column = cell_at(grid, place)
        reach = int(0.5 / grid.resolution)
        goals[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1] = False
    return _walk(grid, open_, goals, begin)


def seen_closed(grid: OccupancyGrid) -> Bools:
    """Return which cells (ny, nx) were seen, or lie between beams of a scan."""
    return np.asarray(ndimage.binary_closing(grid.seen, iterations=CLOSED))


def _walk(grid: OccupancyGrid, open_: Bools, goals: Bools, begin: tuple[int, int]) -> Goal | None:
    """Return the shortest way over open cells to a goal."""
    queue: list[tuple[float, tuple[int, int], tuple[int, int]]] = [(0.0, begin, begin)]
    before: dict[tuple[int, int], tuple[int, int]] = {}
    while queue:
        metres, here, came = heapq.heappop(queue)
        if here in before:
            continue
        before[here] = came
        if goals[here] and here != begin:
            cells = [here]
            while cells[-1] != begin:
                cells.append(before[cells[-1]])
            xy = grid.origin + (np.array(cells[::-1])[:, ::-1] + 0.5) * grid.resolution
            return Goal(xy, metres)
        for i, j in NEIGHBOURS:
            row, column = here[0] + i, here[1] + j
            if 0 <= row < open_.shape[0] and 0 <= column < open_.shape[1] and open_[row, column]:
                heapq.heappush(queue, (metres + grid.resolution * math.hypot(i, j), (row, column), here))
    return None


def cell_at(grid: OccupancyGrid, place: Floats) -> tuple[int, int]:
    """Return row and column of the cell of a place (2,), metres."""
    column, row = np.floor((place - grid.origin) / grid.resolution).astype(int)
    return min(max(row, 0), grid.occupancy.shape[0] - 1), min(max(column, 0), grid.occupancy.shape[1] - 1)


def grid_information(grid: OccupancyGrid, places: Floats, view: float, max_range: float) -> tuple[Floats, Floats]:
    """Return Shannon's information of a scan from each place (n,), cells independent, and the best headings (n,).

    A beam without noise learns of cell c its entropy where all cells before it are free; of a cell that several beams
    pass, that of the beam which reaches it most probably.
    """
    n_rows, n_columns = grid.occupancy.shape
    p = np.clip(grid.occupancy.astype(np.float64), 1e-6, 1.0 - 1e-6)
    entropy = (-p * np.log(p) - (1.0 - p) * np.log1p(-p)).ravel()
    turn = 2.0 * np.pi * np.arange(N_BEAMS) / N_BEAMS
    along = grid.resolution * np.arange(1, int(max_range / grid.resolution))
    step = np.stack([np.cos(turn), np.sin(turn)], axis=-1)[:, None] * along[:, None]
    n_seen = max(1, round(view / (2.0 * np.pi) * N_BEAMS))
    gain, heading = np.zeros(len(places)), np.zeros(len(places))
    for number, place in enumerate(places):
        column, row = np.moveaxis(np.floor((place + step - grid.origin) / grid.resolution).astype(int), -1, 0)
        inside = (row >= 0) & (column >= 0) & (row < n_rows) & (column < n_columns)
        cell = np.where(inside, row * n_columns + column, 0)
        passed = np.cumprod(np.where(inside, 1.0 - p.ravel()[cell], 0.0), axis=1)
        reached = np.hstack([np.ones((N_BEAMS, 1)), passed[:, :-1]]) * inside
        most = np.zeros(n_rows * n_columns)
        np.maximum.at(most, cell.ravel(), reached.ravel())
        # Each cell counts once, for the first beam that reaches it best.
        best = reached >= most[cell] - 1e-12
        n_best = np.zeros(n_rows * n_columns)
        np.add.at(n_best, cell.ravel(), best.ravel().astype(np.float64))
        by_beam = (best * reached * entropy[cell] / np.maximum(n_best[cell], 1.0)).sum(axis=1)
        sums = [by_beam[np.arange(first, first + n_seen) % N_BEAMS].sum() for first in range(N_BEAMS)]
        first = int(np.argmax(sums))
        gain[number], heading[number] = sums[first], turn[first] + 0.5 * view
    return gain, heading
