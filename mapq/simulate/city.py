"""A city of any size for tests of scale: points at random on the surfaces of blocks, each drawn from its own seed.

No rays are cast: every surface gets its share of points at once, some millions a second. The street grid is common, so
that a tile of the city, a LAZ file in a folder, can be made from the blocks that it touches and from nothing else, and
facades continue across the borders of tiles. As in a map with drift some sides of blocks were driven past twice and are
doubled.
"""

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
from mapq.simulate.scene import NO_SURFACE, Kind
from prf.shell.errors import UsageError, cannot_write

PITCH = np.array([66.0, 58.0])
"""Metres from block to block, along x and y."""
STREET = 14.0
"""Metres from facade to facade."""
DENSITY = 40.0
"""Points a square metre of surface: 16 cm apart."""
SIGMA = 0.015
"""Metres: noise along all axes."""
HOUSES = (2, 5)
"""Houses on a side of a block: from, and below."""
SETBACK = 0.8
"""Metres by which a house is behind the street line at most: some are in one line within the noise."""
HEIGHT = (6.0, 13.0)
TWICE = 0.3
"""Chance that a side was seen on two visits that drift parts."""
APART, TURNED = (0.12, 0.7), 1.2
"""By how many metres and up to how many degrees."""
DISAGREEMENT = 0.05
"""Metres along the normal from which both copies are suspicious; as of `Settings`."""
N_CARS, N_TREES = 7, 5
SIDES = 4
SURFACES_OF_BLOCK = 64
"""Numbers of surfaces that a block may use: facades, and the ground."""
POINTS_OF_BLOCK = 146_500
"""Points of a block in the mean."""
POINTS_OF_TILE = 2_500_000
"""Points of a tile at most, about."""
ORIGIN = np.array([512_000.0, 5_403_000.0, 0.0])
"""Of the city, as in a survey grid."""
OFFSET = 0.37
"""Share of a block by which tiles begin off the street grid, so that their borders cut facades."""
LARGEST = 20_000_000_000

Floats = NDArray[np.float64]


class CityPart(NamedTuple):
    """Points (n, 3) in metres with their truth (n,), 1 = suspicious, kind (n,) and surface (n,), -1 = none."""

    xyz: Floats
    truth: NDArray[np.uint8]
    kind: NDArray[np.uint8]
    surface: NDArray[np.int32]

    def take(self, some: NDArray[np.bool_] | NDArray[np.int64]) -> CityPart:
        """Return some of the points (a mask, or their places)."""
        return CityPart(self.xyz[some], self.truth[some], self.kind[some], self.surface[some])


def join(parts: list[CityPart]) -> CityPart:
    """Return the points of all parts, one after the other."""
    xyz, truth, kind, surface = zip(*parts, strict=True)
    return CityPart(np.concatenate(xyz), np.concatenate(truth), np.concatenate(kind), np.concatenate(surface))


def make_block(seed: int, column: int, row: int, number: int) -> CityPart:
    """Return the points of one block, at the corner ``(column, row) * PITCH``, and of half the streets around it.

    Surfaces of the block with this number begin at `SURFACES_OF_BLOCK` times that.
    """
    rng = np.random.default_rng([seed, column, row])
    corner = PITCH * (column, row)
    first = SURFACES_OF_BLOCK * number
    parts = [_ground(rng, first + SURFACES_OF_BLOCK - 1)]
    for side in range(SIDES):
        parts += _side(rng, side, first + side * HOUSES[1])
    parts += [_car(rng) for _ in range(N_CARS)]
    parts += [_tree(rng) for _ in range(N_TREES)]
    block = join(parts)
    xyz = block.xyz + rng.normal(0.0, SIGMA, block.xyz.shape)
    xyz[:, :2] += corner
    return block._replace(xyz=xyz)


def _part(xyz: Floats, kind: Kind, truth: NDArray[np.bool_] | None = None, surface: int = NO_SURFACE) -> CityPart:
    suspicious = np.zeros(len(xyz), np.uint8) if truth is None else truth.astype(np.uint8)
    return CityPart(xyz, suspicious, np.full(len(xyz), kind, np.uint8), np.full(len(xyz), surface, np.int32))


def _ground(rng: np.random.Generator, surface: int) -> CityPart:
    """Return the streets around a block; its yard is not seen."""
    places = rng.uniform(0.0, 1.0, (rng.poisson(DENSITY * PITCH.prod()), 2)) * PITCH
    inside = ((places > 0.5 * STREET) & (places < PITCH - 0.5 * STREET)).all(axis=1)
    kept = places[~inside]
    return _part(np.column_stack([kept, np.zeros(len(kept))]), Kind.GROUND, None, surface)


def _side(rng: np.random.Generator, side: int, surface: int) -> list[CityPart]:
    """Return the houses along one side of a block, twice where two visits disagree."""
    low, high = np.full(2, 0.5 * STREET), PITCH - 0.5 * STREET
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    start, end = corners[side], corners[(side + 1) % SIDES]
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    inward = np.array([-along[1], along[0]])
    n_houses = int(rng.integers(*HOUSES))
    cuts = np.concatenate([[0.0], np.sort(rng.uniform(0.25, 0.75, n_houses - 1) + np.arange(1, n_houses) - 0.5)])
    ends = np.append(cuts[1:], n_houses) * (length / n_houses)
    shift = _displacement(rng)
    parts = []
    for house, (begin, stop) in enumerate(zip(cuts * (length / n_houses), ends, strict=True)):
        place, kind, is_pane = _facade(rng, stop - begin)
        away = place[:, 2] + rng.uniform(0.0, SETBACK)
        s = place[:, 0] + begin
        moved = np.zeros(len(s))
        if shift is not None:
            second = rng.uniform(0.0, 1.0, len(s)) < 0.5
            off = shift[0] + np.radians(shift[1]) * (s - 0.5 * length)
            moved[second] = off[second]
            away = away + moved
            moved = off
        level = start + s[:, None] * along + away[:, None] * inward
        part = _part(np.column_stack([level, place[:, 1]]), Kind.FACADE, np.abs(moved) > DISAGREEMENT)
        numbers = np.where(is_pane, NO_SURFACE, surface + house).astype(np.int32)
        parts.append(part._replace(kind=kind, surface=numbers))
    return parts


def _displacement(rng: np.random.Generator) -> tuple[float, float] | None:
    """Return by how many metres and degrees a second visit is off the first; None without one."""
    chance, metres, sign, degrees = rng.uniform(), rng.uniform(*APART), rng.choice([-1.0, 1.0]), rng.normal()
    return (float(sign * metres), float(np.clip(0.5 * degrees, -1, 1) * TURNED)) if chance < TWICE else None


def _facade(rng: np.random.Generator, length: float) -> tuple[Floats, NDArray[np.uint8], NDArray[np.bool_]]:
    """Return places (n, 3) along, above and behind a facade with windows, their kinds, and which are panes."""
    height, storey, pitch = rng.uniform(*HEIGHT), rng.uniform(3.0, 3.6), rng.uniform(2.8, 3.8)
    width, tall, recess = pitch * rng.uniform(0.45, 0.6), storey * rng.uniform(0.45, 0.6), rng.uniform(0.15, 0.4)
    n = rng.poisson(DENSITY * length * height)
    s, z = rng.uniform(0.0, length, n), rng.uniform(0.0, height, n)
    is_pane = (np.abs(s % pitch - 0.5 * pitch) < 0.5 * width) & (np.abs(z % storey - 0.55 * storey) < 0.5 * tall)
    is_pane &= (z < height - 0.4) & (s < length - length % pitch)
    kind = np.where(is_pane, Kind.RECESS, Kind.FACADE).astype(np.uint8)
    return np.column_stack([s, z, recess * is_pane]), kind, is_pane


def _in_street(rng: np.random.Generator) -> Floats:
    """Return a place (2,) on the half streets around a block."""
    across, along = rng.uniform(1.5, 0.5 * STREET - 2.5), rng.uniform(0.0, 1.0)
    place = np.array([across, along * PITCH[1]]) if rng.uniform() < 0.5 else np.array([along * PITCH[0], across])
    return np.asarray(place if rng.uniform() < 0.5 else PITCH - place)


def _car(rng: np.random.Generator) -> CityPart:
    """Return a car as half an ellipsoid."""
    direction = rng.normal(size=(rng.poisson(DENSITY * 18.0), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction[:, 2] = np.abs(direction[:, 2])
    half = (0.9, 2.2, 1.5) if rng.uniform() < 0.5 else (2.2, 0.9, 1.5)
    return _part(np.append(_in_street(rng), 0.0) + direction * half, Kind.PARKED_CAR)


def _tree(rng: np.random.Generator) -> CityPart:
    """Return the crown of a tree: points all through a ball."""
    radius = rng.uniform(1.2, 2.0)
    direction = rng.normal(size=(rng.poisson(DENSITY * 4.0 * np.pi * radius**2), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    away = radius * rng.uniform(0.0, 1.0, (len(direction), 1)) ** (1 / 3)
    return _part(np.append(_in_street(rng), 2.5 + radius) + direction * away, Kind.FOLIAGE)


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
    """Columns and rows of blocks, and the blocks along the side of a tile."""

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
    """Return a city of about `n_points` points."""
    if not POINTS_OF_BLOCK <= n_points <= LARGEST:
        raise UsageError(f"--n-points {n_points}: a city has {POINTS_OF_BLOCK:,} (a block) to {LARGEST:,}.")
    blocks = n_points / POINTS_OF_BLOCK
    columns = max(1, round(blocks**0.5))
    return City(columns, math.ceil(blocks / columns), max(1, int((points_of_tile / POINTS_OF_BLOCK) ** 0.5)))


def make_tile(city: City, tile: Tile, seed: int) -> CityPart:
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


def _inside(city: City, tile: Tile, block: CityPart) -> NDArray[np.bool_]:
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
