"""A city on disk: LAZ tiles in a folder, each made from the blocks that it touches, in memory of one tile."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.write import write_cloud
from mapq.simulate.city import PITCH, Part, join, make_block
from prf.shell.errors import UsageError, cannot_write

POINTS_OF_BLOCK = 146_500
"""Points of a block in the mean."""
POINTS_OF_TILE = 2_500_000
"""Points of a tile at most, about."""
ORIGIN = np.array([512_000.0, 5_403_000.0, 0.0])
"""Of the city, as in a survey grid."""
OFFSET = 0.37
"""Share of a block by which tiles begin off the street grid, so that their borders cut facades."""
LARGEST = 20_000_000_000


class Tile(NamedTuple):
    """A tile of the city: its place among tiles, and corners in blocks, in x and y."""

    column: int
    row: int
    low: tuple[float, float]
    high: tuple[float, float]

    @property
    def name(self) -> str:
        """File name of the tile."""
        return f"tile_{self.column:03d}_{self.row:03d}.laz"


class City(NamedTuple):
    """Columns and rows of blocks, cut into tiles of so many blocks a side."""

    columns: int
    rows: int
    blocks_of_tile: int

    def tiles(self) -> Iterator[Tile]:
        """Yield the tiles, row by row."""
        x, y = self._cuts(self.columns), self._cuts(self.rows)
        for row in range(len(y) - 1):
            for column in range(len(x) - 1):
                yield Tile(column, row, (x[column], y[row]), (x[column + 1], y[row + 1]))

    def _cuts(self, n_blocks: int) -> list[float]:
        n_tiles = max(1, round(n_blocks / self.blocks_of_tile))
        return [0.0, *(number * self.blocks_of_tile + OFFSET for number in range(1, n_tiles)), float(n_blocks)]


def plan_city(n_points: int, points_of_tile: int = POINTS_OF_TILE) -> City:
    """Return a city of about so many points."""
    if not POINTS_OF_BLOCK <= n_points <= LARGEST:
        raise UsageError(f"--n-points {n_points}: a city has {POINTS_OF_BLOCK:,} (a block) to {LARGEST:,}.")
    blocks = n_points / POINTS_OF_BLOCK
    columns = max(1, round(blocks**0.5))
    return City(columns, math.ceil(blocks / columns), max(1, int((points_of_tile / POINTS_OF_BLOCK) ** 0.5)))


def make_tile(city: City, tile: Tile, seed: int) -> Part:
    """Return the points of one tile, in the frame of the city, in random order."""
    rows = range(int(tile.low[1]), int(np.ceil(tile.high[1])))
    columns = range(int(tile.low[0]), int(np.ceil(tile.high[0])))
    parts = []
    for row in rows:
        for column in columns:
            block = make_block(seed, column, row, row * city.columns + column)
            parts.append(block.take(_inside(city, tile, block)))
    whole = join(parts)
    order = np.random.default_rng([seed, tile.column, tile.row, 1]).permutation(len(whole.xyz))
    return whole.take(order)


def _inside(city: City, tile: Tile, block: Part) -> NDArray[np.bool_]:
    """Return which points (n,) belong to a tile; what noise puts beyond the city belongs to its outermost tiles."""
    place = block.xyz[:, :2] / PITCH
    low = np.where(np.array(tile.low) == 0.0, -np.inf, tile.low)
    high = np.where(np.array(tile.high) == (city.columns, city.rows), np.inf, tile.high)
    return np.asarray(((place >= low) & (place < high)).all(axis=1))


def write_city(
    folder: str | os.PathLike[str],
    n_points: int,
    seed: int,
    points_of_tile: int = POINTS_OF_TILE,
    progress: Callable[[float], None] = lambda share: None,
) -> dict[str, int]:
    """Write a city as LAZ tiles into a folder; return counts of tiles, points and suspicious points.

    The tiles of an earlier city are removed. They have the fields `truth`, `kind` and `surface`. The same numbers and
    seed give the same tiles, and whatever the size of tiles the same points.

    Parameters
    ----------
    folder : path
        Made if absent.
    n_points : int
        At least, about; the city is made of whole blocks.
    seed : int
        Not negative.
    points_of_tile : int
        Of a tile, about.
    progress : callable
        Called with the share of tiles that are written.
    """
    city = plan_city(n_points, points_of_tile)
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for old in target.glob("tile_*.laz"):
            old.unlink()
    except OSError as error:
        raise cannot_write(target, error) from error
    tiles = list(city.tiles())
    counts = {"tiles": len(tiles), "points": 0, "suspicious_points": 0}
    for done, tile in enumerate(tiles, 1):
        part = make_tile(city, tile, seed)
        fields: dict[str, NDArray[Any]] = {"truth": part.truth, "kind": part.kind, "surface": part.surface}
        write_cloud(target / tile.name, PointCloud.from_world(part.xyz + ORIGIN, fields, "simulated"))
        counts["points"] += len(part.xyz)
        counts["suspicious_points"] += int(part.truth.sum())
        progress(done / len(tiles))
    return counts
