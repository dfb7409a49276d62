"""The second pass over the points: each goes to the file of its tile, and of every tile in whose halo it lies."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.assess.visits import Clock, Stays, join_stays, stays_of
from mapq.axes import turn_cloud
from mapq.cloud import PointCloud
from mapq.io.options import ReadOptions
from mapq.scale.files import save_arrays
from mapq.scale.source import Range, Source, read_range
from mapq.scale.tiling import Tiling

Array = NDArray[Any]


class SpoolTask(NamedTuple):
    """What the spooling of a range is given.

    What is read, with which fields; by how many quarters points are turned to lie in the map's own axes, in which all
    else is; the tiles; the box (2, 3) of the map; by which fields it is known when points were seen; the work folder.
    """

    source: Source
    options: ReadOptions
    part: Range
    shift: NDArray[np.float64]
    quarter: int
    tiling: Tiling
    near: NDArray[np.float64]
    fields: tuple[str, ...]
    clock: Clock | None
    folder: str


class Spooled(NamedTuple):
    """What a range gave: tiles that it touches, points that belong to them and those of halos; the sensor's way."""

    part: int
    tiles: tuple[int, ...]
    n_own: tuple[int, ...]
    n_halo: tuple[int, ...]
    stays: Stays | None


class TilePoints(NamedTuple):
    """Points of a tile from one range, its own first.

    Attributes
    ----------
    xyz : (n, 3) float64
    row : (n,) int32
        Place in the range.
    n_own : int
        Points that belong to the tile; the others are halo.
    fields : dict of str to (n,) array
    """

    xyz: NDArray[np.float64]
    row: NDArray[np.int32]
    n_own: int
    fields: dict[str, Array]


def spool_path(folder: str, tile: int, part: int) -> str:
    """Return the file of a tile's points of one range."""
    return os.path.join(folder, f"spool_{tile:05d}_{part:05d}.npz")


def spool_range(task: SpoolTask) -> Spooled:
    """Write the points of a range to the files of the tiles."""
    own: dict[int, list[dict[str, Array]]] = {}
    halo: dict[int, list[dict[str, Array]]] = {}
    stays: list[Stays] = []
    begin, near = 0, task.near
    for read in read_range(task.source, task.options, task.part, task.shift, task.fields):
        piece = turn_cloud(read, task.quarter)
        with np.errstate(invalid="ignore"):
            usable = np.flatnonzero(((piece.xyz >= near[0]) & (piece.xyz <= near[1])).all(axis=1))
        columns = _columns(piece, usable, begin)
        begin += len(piece)
        if len(usable) == 0:
            continue
        if task.clock is not None:
            stays.append(stays_of(piece.take(usable), task.clock)[0])
        tile = task.tiling.of_points(columns["xyz"])
        order = np.argsort(tile, kind="stable")
        cuts = np.flatnonzero(np.diff(tile[order])) + 1
        for rows in np.split(order, cuts):
            _add(own, int(tile[rows[0]]), columns, rows)
        for number, rows in _in_halos(columns["xyz"], tile, task.tiling.boxes, task.tiling.halo):
            _add(halo, number, columns, rows)
    tiles = tuple(sorted(own.keys() | halo.keys()))
    sizes = [_write(spool_path(task.folder, tile, task.part.number), own, halo, tile) for tile in tiles]
    n_own, n_halo = (tuple(size[side] for size in sizes) for side in (0, 1))
    return Spooled(task.part.number, tiles, n_own, n_halo, join_stays(stays) if stays else None)


def _columns(piece: PointCloud, usable: NDArray[np.int64], begin: int) -> dict[str, Array]:
    plain = {name: values for name, values in piece.fields.items() if values.ndim == 1}
    fields = {f"field_{name}": values[usable] for name, values in plain.items()}
    return {"xyz": piece.xyz[usable], "row": (usable + begin).astype(np.int32), **fields}


def _in_halos(
    xyz: NDArray[np.float64], tile: NDArray[np.int32], boxes: NDArray[np.float64], halo: float
) -> list[tuple[int, NDArray[np.int64]]]:
    """Return the tiles in whose halo some of the points lie, with the places of these."""
    low, high = xyz[:, :2].min(axis=0), xyz[:, :2].max(axis=0)
    wide = boxes + halo * np.array([-1.0, -1.0, 1.0, 1.0])
    found = []
    for number in np.flatnonzero((wide[:, :2] <= high).all(axis=1) & (wide[:, 2:] >= low).all(axis=1)):
        inside = tile != number
        for axis in range(2):
            inside &= (xyz[:, axis] >= wide[number, axis]) & (xyz[:, axis] < wide[number, 2 + axis])
        rows = np.flatnonzero(inside)
        if len(rows):
            found.append((int(number), rows))
    return found


def _add(
    parts: dict[int, list[dict[str, Array]]], tile: int, columns: dict[str, Array], rows: NDArray[np.int64]
) -> None:
    parts.setdefault(tile, []).append({name: values[rows] for name, values in columns.items()})


def _write(
    path: str, own: dict[int, list[dict[str, Array]]], halo: dict[int, list[dict[str, Array]]], tile: int
) -> tuple[int, int]:
    """Write the points of one tile, its own first; return how many are its own, and how many are not."""
    mine, around = own.pop(tile, []), halo.pop(tile, [])
    both = [*mine, *around]
    columns = {name: np.concatenate([part[name] for part in both]) for name in both[0]}
    n_own = sum(len(part["row"]) for part in mine)
    save_arrays(path, n_own=np.array(n_own), **columns)
    return n_own, len(columns["row"]) - n_own


def read_tile_points(folder: str, tile: int, part: int) -> TilePoints:
    """Return the points of a tile from one range."""
    with np.load(spool_path(folder, tile, part)) as arrays:
        fields = {name.removeprefix("field_"): arrays[name] for name in arrays.files if name.startswith("field_")}
        return TilePoints(arrays["xyz"], arrays["row"], int(arrays["n_own"]), fields)


def read_rows(folder: str, tile: int, part: int, n_own: int) -> NDArray[np.int32]:
    """Return the places (n_own,) in a range of the points that belong to a tile."""
    with np.load(spool_path(folder, tile, part)) as arrays:
        rows: NDArray[np.int32] = arrays["row"][:n_own]
    return rows
