"""Tiles: rectangles of the ground plan with about as many points each, and the halo around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

HALO_IN_GAPS, HALO_IN_SPACING = 8.0, 48.0
"""Width of the halo: so many of the widest gap that a patch may bridge, and of the spacing of points."""
MIDDLE = (0.05, 0.95)
"""Quantiles of the points between which a part of the map has its length: a stray point far off does not stretch it."""
CELLS_OF_TILE = 16
"""The fullest cell has at most the points of a tile over this, so that tiles can be cut; else cells are too coarse."""


class Tiling(NamedTuple):
    """Rectangles that together are the plane.

    Attributes
    ----------
    cell : float
        Side in metres of the cells that tiles are made of.
    splits : (t - 1, 4) int64
        A tree that leads to them: axis (0 for x, 1 for y), first cell beyond the border, and where to go on below and
        beyond it: at another row, or in the tile ``-1 - value`` where that is negative.
    boxes : (t, 4) float64
        Corners in metres, lower x and y, then upper ones; at the edge of the map they reach to infinity.
    halo : float
        Metres around a tile whose points it sees too.
    """

    cell: float
    splits: Ints
    boxes: Floats
    halo: float

    def of_points(self, xyz: Floats) -> NDArray[np.int32]:
        """Return the tile (n,) of each point (n, 3)."""
        places = cells_of(xyz, self.cell)
        tile = np.zeros(len(xyz), np.int32)
        waiting = [(0, np.arange(len(xyz)))] if len(self.splits) else []
        while waiting:
            node, rows = waiting.pop()
            axis, at, *sides = self.splits[node].tolist()
            is_beyond = places[rows, axis] >= at
            for to, some in zip(sides, (rows[~is_beyond], rows[is_beyond]), strict=True):
                if to < 0:
                    tile[some] = -1 - to
                elif len(some):
                    waiting.append((to, some))
        return tile

    def neighbours(self, tile: int) -> Ints:
        """Return the tiles (k,) whose points and halo a tile's halo can touch."""
        low, high = self.boxes[:, :2] - 2.0 * self.halo, self.boxes[:, 2:] + 2.0 * self.halo
        near = (low <= self.boxes[tile, 2:]).all(axis=1) & (high >= self.boxes[tile, :2]).all(axis=1)
        return np.setdiff1d(np.flatnonzero(near), [tile])


def cells_of(xyz: Floats, side: float) -> Ints:
    """Return the cell (n, 2) of the ground plan that each point (n, 3) lies in.

    The middles of cells are the multiples of their side. So cells of points turned by quarters are the cells turned;
    also of points on a border, which are common where coordinates are whole centimetres: they go to the even cell.
    """
    return np.rint(xyz[:, :2] / side).astype(np.int64)


def halo_width(spacing: float, max_gap: float) -> float:
    """Return the width of the halo in metres."""
    return max(HALO_IN_GAPS * max_gap, HALO_IN_SPACING * spacing)


def is_too_coarse(counts: Ints, most_points: int) -> bool:
    """Return whether some cell has so many points that tiles cannot be cut well."""
    return int(counts.max()) * CELLS_OF_TILE > most_points


def make_tiling(cells: Ints, counts: Ints, cell: float, most_points: int, halo: float) -> Tiling:
    """Return tiles of at most about `most_points` points, from the counts (k,) of cells (k, 2).

    The map is cut in two again and again across its longer side, so that both parts get as many tiles as points.
    """
    n_tiles = max(1, -(-int(counts.sum()) // most_points))
    splits: list[list[int]] = []
    boxes: list[Floats] = []
    _split(cells, counts, np.array([-np.inf, -np.inf, np.inf, np.inf]), n_tiles, splits, boxes)
    rows = np.array(splits, np.int64).reshape(-1, 4)
    return Tiling(cell, rows, (np.array(boxes) - 0.5) * cell, halo)


def _split(cells: Ints, counts: Ints, box: Floats, n_tiles: int, splits: list[list[int]], boxes: list[Floats]) -> int:
    """Cut a part of the map, whose corners are given in cells, into tiles; return where the tree leads to it."""
    axis = _longer_side(cells, counts)
    places, number = np.unique(cells[:, axis], return_inverse=True)
    if n_tiles == 1 or len(places) == 1:
        boxes.append(box)
        return -len(boxes)
    before = n_tiles // 2
    sums = np.cumsum(np.bincount(number.ravel(), counts))
    last = min(int(np.searchsorted(sums, sums[-1] * before / n_tiles)), len(places) - 2)
    at = int(places[last]) + 1
    below, beyond = box.copy(), box.copy()
    below[2 + axis] = beyond[axis] = at
    row = len(splits)
    splits.append([axis, at, 0, 0])
    some = cells[:, axis] < at
    splits[row][2] = _split(cells[some], counts[some], below, before, splits, boxes)
    splits[row][3] = _split(cells[~some], counts[~some], beyond, n_tiles - before, splits, boxes)
    return row


def _longer_side(cells: Ints, counts: Ints) -> int:
    """Return the axis along which the middle points of some cells reach farther; one along which cells differ."""
    length = []
    for axis in range(2):
        order = np.argsort(cells[:, axis], kind="stable")
        sums = np.cumsum(counts[order])
        low, high = cells[order[np.searchsorted(sums, np.array(MIDDLE) * sums[-1])], axis]
        length.append((int(high - low), int(np.ptp(cells[:, axis]))))
    return int(length[1] > length[0])
