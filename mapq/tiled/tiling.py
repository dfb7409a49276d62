"""Tiles: rectangles of the ground plan with about as many points each, the halo around them, and their files."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import keys_of, turn

HALO_IN_GAPS, HALO_IN_SPACING = 8.0, 48.0
"""Width of the halo, in widest gaps that a patch may bridge, and in spacings of points."""
SMALLEST_CELL = 0.25
"""Metres: side of the cells of the ground plan in which points are counted at first."""
MOST_CELLS = 1_000_000
"""Counted cells; of more, four are joined to one."""

FARTHEST = 2.0**30
"""Cells from the origin; what lies farther off counts as if it lay there."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Records = NDArray[np.void]


class Counts(NamedTuple):
    """Points counted in cells of the ground plan: side in metres, cells (k, 2), counts (k,)."""

    side: float = SMALLEST_CELL
    cells: Ints = np.zeros((0, 2), np.int64)
    counts: Ints = np.zeros(0, np.int64)

    def plus(self, xyz: Floats) -> Counts:
        """Return the counts with further points (n, 3)."""
        found = self._joined(cells_of(xyz, self.side), np.ones(len(xyz), np.int64))
        while len(found.cells) > MOST_CELLS:
            found = found._replace(side=2.0 * found.side, cells=found.cells[:0], counts=found.counts[:0])._joined(
                found.cells >> 1, found.counts
            )
        return found

    def turned(self, quarter: int) -> Counts:
        """Return the counts of points turned by quarters: cells are turned about their middles."""
        return self._replace(cells=(turn(2 * self.cells + 1, quarter) - 1) // 2)

    def drawn(self, n_points: int) -> Ints:
        """Return the keys (d,) of cells drawn at random, with about this many points in all."""
        order = np.random.default_rng(0).permutation(len(self.cells))
        before = np.cumsum(self.counts[order]) - self.counts[order]
        return keys_of(self.cells[order[before < n_points]])

    def _joined(self, cells: Ints, counts: Ints) -> Counts:
        cells, counts = np.concatenate([self.cells, cells]), np.concatenate([self.counts, counts])
        _, first, place = np.unique(keys_of(cells), return_index=True, return_inverse=True)
        return Counts(self.side, cells[first], np.bincount(place, counts, len(first)).astype(np.int64))


class Tiling(NamedTuple):
    """Rectangles (t, 4) that together are the plane: lower x and y, then upper ones, in metres; inf at the edge."""

    boxes: Floats

    def of_points(self, xyz: Floats) -> Ints:
        """Return the tile (n,) of each point (n, 3)."""
        tile = np.zeros(len(xyz), np.int64)
        low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
        for number in np.flatnonzero((self.boxes[:, :2] <= high).all(axis=1) & (self.boxes[:, 2:] > low).all(axis=1)):
            tile[self.near(xyz, int(number), 0.0)] = number
        return tile

    def near(self, xyz: Floats, tile: int, halo: float) -> NDArray[np.bool_]:
        """Return which points (n, 3) lie in a tile or its halo."""
        x0, y0, x1, y1 = self.boxes[tile] + halo * np.array([-1.0, -1.0, 1.0, 1.0])
        x, y = xyz[:, 0], xyz[:, 1]
        return np.asarray((x >= x0) & (x < x1) & (y >= y0) & (y < y1))

    def neighbours(self, tile: int, halo: float) -> Ints:
        """Return the tiles (k,) that lie within twice the halo of a tile."""
        low, high = self.boxes[:, :2] - 2.0 * halo, self.boxes[:, 2:] + 2.0 * halo
        near = (low <= self.boxes[tile, 2:]).all(axis=1) & (high >= self.boxes[tile, :2]).all(axis=1)
        return np.setdiff1d(np.flatnonzero(near), [tile])


def cells_of(xyz: Floats, side: float) -> Ints:
    """Return the cell (n, 2) of the ground plan of each point (n, 3)."""
    return np.clip(np.floor(xyz[:, :2] / side), -FARTHEST, FARTHEST).astype(np.int64)


def make_tiling(found: Counts, most_points: int) -> Tiling:
    """Return tiles of at most about `most_points` points: the plan is halved again and again across its longer side."""
    n_tiles = max(1, -(-int(found.counts.sum()) // most_points))
    everywhere = np.array([-np.inf, -np.inf, np.inf, np.inf])
    return Tiling(np.array(_split(found.cells, found.counts, everywhere, n_tiles)) * found.side)


def _split(cells: Ints, counts: Ints, box: Floats, n_tiles: int) -> list[Floats]:
    """Return the tiles of a part of the plan; boxes are in cells."""
    middle = np.quantile(cells, (0.05, 0.95), axis=0) if len(cells) else np.zeros((2, 2))
    axis = int(np.argmax(np.ptp(middle, axis=0)))
    axis = axis if len(cells) and np.ptp(cells[:, axis]) else 1 - axis
    places, number = np.unique(cells[:, axis], return_inverse=True)
    if n_tiles == 1 or len(places) < 2:
        return [box]
    before = n_tiles // 2
    sums = np.cumsum(np.bincount(number, counts))
    at = int(places[min(int(np.searchsorted(sums, sums[-1] * before / n_tiles)), len(places) - 2)]) + 1
    below, beyond = box.copy(), box.copy()
    below[2 + axis] = beyond[axis] = at
    some = cells[:, axis] < at
    return _split(cells[some], counts[some], below, before) + _split(
        cells[~some], counts[~some], beyond, n_tiles - before
    )


class WorkFolder(NamedTuple):
    """Points in files, a record a point: `xyz`, `number` among all points of the map, and fields as float64."""

    folder: str
    fields: tuple[str, ...]

    @property
    def record(self) -> np.dtype[np.void]:
        """The type of a record."""
        return np.dtype([("xyz", "<f8", 3), ("number", "<i8"), *((name, "<f8") for name in self.fields)])

    def path(self, kind: str, tile: int) -> str:
        """Return the file of a tile: ``spool``, ``points`` or ``border``."""
        return os.path.join(self.folder, f"{kind}_{tile:05d}")

    def append(self, tile: int, records: Records) -> None:
        """Add points to the spool of a tile."""
        with open(self.path("spool", tile), "ab") as stream:
            stream.write(records.tobytes())

    def spooled(self, tile: int) -> Records:
        """Return the points of a tile in the order in which they were read."""
        path = self.path("spool", tile)
        if not os.path.exists(path):
            return np.zeros(0, self.record)
        return np.memmap(path, self.record, "r")

    def write_points(self, tile: int, records: Records) -> None:
        """Write the points of a tile, region after region."""
        with open(self.path("points", tile), "wb") as stream:
            stream.write(records.tobytes())

    def points(self, slices: Ints) -> list[Records]:
        """Return points of tiles by slices (s, 4): tile, begin, end, step."""
        files = {tile: np.memmap(self.path("points", tile), self.record, "r") for tile in set(slices[:, 0].tolist())}
        return [files[tile][begin:end:step] for tile, begin, end, step in slices.tolist()]
