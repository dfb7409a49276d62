"""Which ground beams pass, and the beams that must stay so that it stays passed.

Free space is known by the beams that cross it, and some of it by a few alone: those that look through a door, or
along a wall. A cell that is passed must stay passed by some beams, or what was seen would become unseen.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels.grid import make_grid, most_cells
from prf.kernels.passed_cells import choose_lacking, count_passes
from prf.window import Window

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CELL = 0.25
"""Side of a cell in metres."""
SQUARE = 4
"""Cells along a side of the squares that seen ground is measured by: 1 m, so that few beams see it as well as many."""
MOST_CELLS = 4_000_000
"""Cells are larger in a window that would need more."""
PASSING = 2
"""Beams that stay in each cell at least, if as many pass it or end in it."""
GAINS = (16, 4, 1)
"""Cells lacking a beam that a beam must pass to be taken: first those that pass many, so that few are taken."""


class Passages:
    """Beams as segments, and how many of them pass each cell.

    Parameters
    ----------
    window : Window
    start, end : (n, 2) arrays
        Of the beams, metres, inside the window.
    """

    def __init__(self, window: Window, start: Floats, end: Floats) -> None:
        self._grid = make_grid(*window, max(CELL, math.sqrt(window.area / MOST_CELLS)))
        self._path = np.empty(most_cells(self._grid), np.int32)
        self._start, self._end = np.ascontiguousarray(start), np.ascontiguousarray(end)
        self._passes = self._count(np.ones(len(start), np.bool_))

    def seen_area(self) -> float:
        """Return the ground that beams pass, square metres."""
        nx, ny = self._grid.nx, self._grid.ny
        seen = np.pad((self._passes > 0).reshape(ny, nx), ((0, -ny % SQUARE), (0, -nx % SQUARE)))
        squares = seen.reshape(seen.shape[0] // SQUARE, SQUARE, seen.shape[1] // SQUARE, SQUARE)
        return float(np.count_nonzero(squares.any(axis=(1, 3)))) * (SQUARE * self._grid.cell) ** 2

    def complete(self, kept: Bools) -> None:
        """Add to `kept` (n,) beams by which every cell is passed :data:`PASSING` times, or as often as by all."""
        wanted = np.minimum(self._passes, PASSING) - self._count(kept)
        for least in GAINS:
            choose_lacking(self._grid, self._start, self._end, least, self._path, wanted, kept)

    def _count(self, chosen: Bools) -> Ints:
        passes = np.zeros(self._grid.nx * self._grid.ny, np.int64)
        count_passes(self._grid, self._start, self._end, chosen, self._path, passes)
        return passes
