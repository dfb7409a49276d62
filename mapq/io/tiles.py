"""The files of a map in tiles, a result in tiles among them: read a piece at a time, as it may not fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud, choose_shift
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.clouds import read_cloud
from mapq.io.content import Content
from mapq.io.las import CloudHead, read_las_head, read_las_pieces
from mapq.io.results import PATCH, RESULT_FIELDS, stated_unit
from mapq.io.write import LAS_SUFFIXES
from mapq.labels import NO_PATCH
from prf.shell.errors import InputError

LAS_MAGIC = b"LASF"
RESULT_JSON = "result.json"
"""Name of the file with the patches among the tiles of a result."""

Ints = NDArray[np.int64]


class MapFiles(NamedTuple):
    """The files of a map in order, with the shift (3,) of all their points in world coordinates."""

    path: str
    heads: tuple[CloudHead, ...]
    options: ReadOptions
    shift: NDArray[np.float64]

    @property
    def json(self) -> Path:
        """The file with the patches, of a result."""
        return Path(self.path, RESULT_JSON)

    @property
    def n_points(self) -> int:
        """Points of all files."""
        return sum(head.n_points for head in self.heads)

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields that all files have."""
        return tuple(name for name in self.heads[0].fields if all(name in head.fields for head in self.heads))

    def pieces(self, names: tuple[str, ...] | None = None) -> Iterator[tuple[int, PointCloud]]:
        """Yield the points in order, with the number of their file; with some of the fields (None: all).

        LAS is read in pieces, other formats whole.
        """
        for number, head in enumerate(self.heads):
            if head.las_header:
                for piece in read_las_pieces(head.path, self.options, self.shift, names):
                    yield number, piece
                continue
            cloud = read_cloud(head.path, self.options)
            xyz = (cloud.world() - self.shift) * cloud.unit
            fields = {name: values for name, values in cloud.fields.items() if names is None or name in names}
            yield number, replace(cloud, xyz=xyz, shift=self.shift, fields=fields)


def is_tiled(path: str) -> bool:
    """Return whether a path is a folder of LAS or LAZ files."""
    return Path(path).is_dir() and bool(_tiles_in(path))


def is_result_folder(path: str) -> bool:
    """Return whether a path is a folder with the JSON of a result in it."""
    return Path(path, RESULT_JSON).is_file()


def open_map(path: str, options: ReadOptions) -> MapFiles:
    """Return a map: the LAS and LAZ files of a folder by name, or one file of any format.

    Raises InputError if a file cannot be read, or they have different units.
    """
    heads = tuple(_look_at(each, options) for each in (_tiles_in(path) if is_tiled(path) else [path]))
    for other in heads[1:]:
        if not np.array_equal(other.unit, heads[0].unit):
            raise InputError(f"{other.path}: its unit is not that of {heads[0].path}. Give it with --unit.")
    return _together(path, heads, options)


def open_result_folder(path: str, options: ReadOptions = AS_IT_IS) -> MapFiles:
    """Return a result in tiles, of which only the heads are read, in the unit in which it was classified."""
    tiles = _tiles_in(path)
    if not tiles:
        raise InputError(f"{path}: no LAS or LAZ tile beside {RESULT_JSON}. Run mapq classify again.")
    unit = stated_unit(Path(path, RESULT_JSON)) if options.unit is None else None
    if unit is not None and (unit == unit[0]).all():  # else it is that of the tiles' own reference system
        options = options.replace(unit=float(unit[0]))
    heads = tuple(read_las_head(tile, options) for tile in tiles)
    for head in heads:
        missing = [name for name in RESULT_FIELDS if name not in head.fields]
        if missing:
            raise InputError(
                f"{head.path}: expected a tile of a result, with the field {missing[0]}. Run mapq classify again."
            )
        if not np.array_equal(head.unit, heads[0].unit):
            raise InputError(f"{head.path}: its unit differs from that of {tiles[0]}. Classify them with --unit.")
    return _together(path, heads, options)


def _tiles_in(folder: str) -> list[str]:
    """Return the LAS and LAZ files of a folder, by name."""
    return [str(each) for each in sorted(Path(folder).iterdir()) if each.suffix.lower() in LAS_SUFFIXES]


def _look_at(path: str, options: ReadOptions) -> CloudHead:
    if Content(path).head.startswith(LAS_MAGIC):
        return read_las_head(path, options)
    cloud = read_cloud(path, options)
    world = cloud.world()[cloud.finite()]
    return CloudHead(path, len(cloud), world.min(axis=0), world.max(axis=0), cloud.unit, tuple(cloud.fields))


def _together(path: str, heads: tuple[CloudHead, ...], options: ReadOptions) -> MapFiles:
    box = np.array([np.min([head.low for head in heads], axis=0), np.max([head.high for head in heads], axis=0)])
    return MapFiles(path, heads, options, choose_shift(box))


def thinned(folder: MapFiles, names: tuple[str, ...], n_most: int) -> PointCloud:
    """Return at most `n_most` of the points as one cloud: every n-th of each piece."""
    step = max(1, -(-folder.n_points // n_most))
    begin, parts = 0, []
    for _, piece in folder.pieces(names):
        parts.append(piece.take(np.arange(-begin % step, len(piece), step)))
        begin += len(piece)
    return _joined(parts)


def thinned_by_patch(folder: MapFiles, n_points: Ints, n_most: int) -> PointCloud:
    """Return about `n_most` of the points as one cloud, with the fields of a result; of small patches all of them.

    `n_points` (m,) is that of each patch.
    """
    n_loose = max(folder.n_points - int(n_points.sum()), 0)
    share = n_most // 4 if n_loose > n_most // 4 else n_loose
    step = np.append(steps_of(n_points, n_most - share), max(1, -(-n_loose // max(share, 1))))
    n_before = np.zeros(len(step), np.int64)
    parts = []
    for _, piece in folder.pieces(RESULT_FIELDS):
        patch = np.asarray(piece.fields[PATCH]).astype(np.int64)
        patch = np.where((patch < 0) | (patch >= len(n_points)), NO_PATCH, patch) % len(step)
        order = np.argsort(patch, kind="stable")
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order)) - np.searchsorted(patch[order], patch[order])
        parts.append(piece.take(np.flatnonzero((n_before[patch] + rank) % step[patch] == 0)))
        n_before += np.bincount(patch, minlength=len(step))
    return _joined(parts)


def steps_of(n_points: Ints, n_most: int) -> Ints:
    """Return of how many points of each patch (m,) one is taken: about `n_most` in all, and all of small patches."""
    ordered = np.sort(n_points)
    taken = np.cumsum(ordered) - ordered + ordered * np.arange(len(ordered), 0, -1)
    fits = int(np.searchsorted(taken, n_most, side="right"))
    if fits == len(ordered):
        return np.ones(len(n_points), np.int64)
    left = n_most - int(ordered[:fits].sum())
    return np.maximum(1, -(-n_points // max(left // (len(ordered) - fits), 1)))


def _joined(parts: list[PointCloud]) -> PointCloud:
    first = parts[0]
    fields = {name: np.concatenate([part.fields[name] for part in parts]) for name in first.fields}
    xyz = np.concatenate([part.xyz for part in parts])
    return PointCloud(xyz, first.shift, fields, first.coordinate_type, first.source, first.unit)
