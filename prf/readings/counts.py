"""How many beams of a log reach each place on the ground, and how many return from it, whatever a map says of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels.state.grid import make_grid
from prf.model.layout import pixel_centres
from prf.model.window import Window
from prf.readings.ground import MAX_CELLS, count_beams
from prf.readings.readings import Readings

CELL = 0.05
"""Side of the cells, metres: about what returns of one wall spread by; larger in a window that would need too many."""

Floats = NDArray[np.float64]


class BeamCounts(NamedTuple):
    """How many beams of the chosen scans, thinned away or not, reach each cell, and how many return from it.

    Attributes
    ----------
    passes, returns : (ny, nx) int32
        Row 0 is the lowest.
    origin : (2,) float64
        Lower left corner of cell (0, 0), metres.
    cell : float
        Side of a cell, metres.
    """

    passes: NDArray[np.int32]
    returns: NDArray[np.int32]
    origin: Floats
    cell: float

    def joined(self, other: BeamCounts | None, window: Window) -> BeamCounts:
        """Return the counts of these beams and others on the cells of a window; those of larger cells are more."""
        grid = make_grid(*window, max(CELL, math.sqrt(window.area / MAX_CELLS)))
        passes, returns = np.zeros((2, grid.ny, grid.nx), np.int32)
        centres = pixel_centres(grid)
        for each in (self, other):
            if each is not None:
                times = grid.cell / each.cell
                passes += np.rint(times * each.at(each.passes, centres)).astype(np.int32).reshape(passes.shape)
                returns += np.rint(times**2 * each.at(each.returns, centres)).astype(np.int32).reshape(passes.shape)
        return BeamCounts(passes, np.minimum(returns, passes), np.array([grid.x0, grid.y0]), grid.cell)

    def at(self, image: NDArray[np.int32], xy: Floats) -> NDArray[np.int32]:
        """Return the values (n,) of one of the images in the cells of points (n, 2), 0 outside."""
        column, row = np.floor((xy - self.origin) / self.cell).astype(np.int64).T
        inside = (column >= 0) & (row >= 0) & (column < image.shape[1]) & (row < image.shape[0])
        found = np.zeros(len(xy), np.int32)
        found[inside] = image[row[inside], column[inside]]
        return found

    def within(self, xy: Floats, side: float) -> tuple[Floats, Floats]:
        """Return how many beams end, and how many cross, in the square of this side round each point (n, 2): (n,) each.

        A beam that covers a part of the way across counts as so much of one that crosses.
        """
        low, high = (xy - self.origin - 0.5 * side) / self.cell, (xy - self.origin + 0.5 * side) / self.cell
        ends = _sums(self.returns, low, high)
        cells = _sums(self.passes - self.returns, low, high)
        return ends, cells * (self.cell / side)


def beam_counts(window: Window, beams: Readings) -> BeamCounts:
    """Return the counts of beams whose sensors are inside the window."""
    grid = make_grid(*window, max(CELL, math.sqrt(window.area / MAX_CELLS)))
    passes, returns, _ = count_beams(grid, window, beams.origin, beams.angle, beams.range, beams.max_range)
    reaching, ending = (each.reshape(grid.ny, grid.nx).astype(np.int32) for each in (passes, returns))
    return BeamCounts(reaching, ending, np.array([grid.x0, grid.y0]), grid.cell)


def _sums(image: NDArray[np.int32], low: Floats, high: Floats) -> Floats:
    """Return the sum over the rectangle between corners (n, 2), in cells; a cell cut by its border counts in part."""
    table = np.zeros((image.shape[0] + 1, image.shape[1] + 1))
    table[1:, 1:] = image.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)

    def below(x: Floats, y: Floats) -> Floats:
        x, y = np.clip(x, 0.0, image.shape[1]), np.clip(y, 0.0, image.shape[0])
        column = np.minimum(x.astype(np.int64), image.shape[1] - 1)
        row = np.minimum(y.astype(np.int64), image.shape[0] - 1)
        right, up = x - column, y - row
        lower = (1.0 - right) * table[row, column] + right * table[row, column + 1]
        upper = (1.0 - right) * table[row + 1, column] + right * table[row + 1, column + 1]
        return np.asarray((1.0 - up) * lower + up * upper)

    left, bottom, right, top = *low.T, *high.T
    return np.maximum(below(right, top) - below(left, top) - below(right, bottom) + below(left, bottom), 0.0)
