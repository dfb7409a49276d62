"""Tiles: rectangles of the ground plan with about as many points each, and the halo around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HALO_IN_GAPS, HALO_IN_SPACING = 4.0, 24.0
"""Width of the halo: so many of the widest gap that a patch may bridge, and of the spacing of points."""
MOST_CELLS = 2048
"""Cells along a side of the table of tiles; finer counts are summed up."""


class Tiling(NamedTuple):
    """Rectangles that together are the map.

    Attributes
    ----------
    cell : float
        Side in metres of the cells that tiles are made of.
    first : (2,) int64
        Cell at the corner of the map.
    size : (2,) int64
        Cells of the map.
    tiles : (t, 4) int64
        Of each tile the first cell in x and y and the one behind the last, counted from `first`.
    halo : float
        Metres around a tile whose points it sees too.
    """

    cell: float
    first: Ints
    size: Ints
    tiles: Ints
    halo: float

    def table(self) -> NDArray[np.int32]:
        """Return the tile of each cell (size)."""
        out = np.zeros(tuple(self.size.tolist()), np.int32)
        for number, (left, low, right, high) in enumerate(self.tiles.tolist()):
            out[left:right, low:high] = number
        return out

    def boxes(self) -> Floats:
        """Return the corners (t, 4) of tiles in metres; at the edge of the map they reach to infinity."""
        low = np.where(self.tiles[:, :2] == 0, -np.inf, (self.tiles[:, :2] + self.first) * self.cell)
        high = np.where(self.tiles[:, 2:] == self.size, np.inf, (self.tiles[:, 2:] + self.first) * self.cell)
        return np.hstack([low, high])

    def of_points(self, xyz: Floats, table: NDArray[np.int32]) -> NDArray[np.int32]:
        """Return the tile (n,) of each point, given the table."""
        place = np.floor(xyz[:, :2] / self.cell).astype(np.int64) - self.first
        place = np.clip(place, 0, self.size - 1)
        return np.asarray(table[place[:, 0], place[:, 1]])

    def neighbours(self, tile: int) -> Ints:
        """Return the tiles (k,) whose points and halo a tile's halo can touch."""
        boxes = self.boxes()
        low, high = boxes[:, :2] - 2.0 * self.halo, boxes[:, 2:] + 2.0 * self.halo
        near = np.flatnonzero((low <= boxes[tile, 2:]).all(axis=1) & (high >= boxes[tile, :2]).all(axis=1))
        return np.setdiff1d(near, [tile])


def halo_width(spacing: float, max_gap: float) -> float:
    """Return the width of the halo in metres."""
    return max(HALO_IN_GAPS * max_gap, HALO_IN_SPACING * spacing)


def make_tiling(cells: Ints, counts: Ints, cell: float, most_points: int, halo: float) -> Tiling:
    """Return tiles of at most about `most_points` points, from the counts (k,) of cells (k, 2).

    The map is halved again and again across its longer side, so that both halves get as many tiles as points.
    """
    while (np.ptp(cells, axis=0) >= MOST_CELLS).any():
        cell *= 2.0
        cells, place = np.unique(cells >> 1, axis=0, return_inverse=True)
        counts = np.bincount(place.ravel(), counts, len(cells)).astype(np.int64)
    first = cells.min(axis=0)
    size = cells.max(axis=0) - first + 1
    dense = np.zeros(tuple(size.tolist()), np.int64)
    dense[tuple((cells - first).T)] = counts
    n_tiles = max(1, -(-int(counts.sum()) // most_points))
    return Tiling(cell, first, size, np.array(_split(dense, 0, 0, n_tiles), np.int64), halo)


def _split(counts: Ints, left: int, low: int, n_tiles: int) -> list[tuple[int, int, int, int]]:
    """Return the tiles of a part of the map that begins at a cell."""
    whole = [(left, low, left + counts.shape[0], low + counts.shape[1])]
    if n_tiles <= 1 or max(counts.shape) == 1:
        return whole
    axis = int(counts.shape[1] > counts.shape[0])
    sums = np.cumsum(counts.sum(axis=1 - axis))
    before = n_tiles // 2
    at = int(np.searchsorted(sums, sums[-1] * before / n_tiles)) + 1
    at = min(max(at, 1), counts.shape[axis] - 1)
    one, other = np.split(counts, [at], axis=axis)
    behind = _split(other, left + at * (1 - axis), low + at * axis, n_tiles - before)
    return _split(one, left, low, before) + behind
