"""A result in tiles, as `mapq classify` makes it of a folder: read a piece at a time, as it may not fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud, choose_shift
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.las import LasHead, read_las_head, read_las_pieces
from mapq.io.results import PATCH, RESULT_FIELDS, stated_unit
from mapq.io.write import LAS_SUFFIXES
from mapq.labels import NO_PATCH
from prf.shell.errors import InputError

RESULT_JSON = "result.json"

Ints = NDArray[np.int64]


class ResultFolder(NamedTuple):
    """A result in tiles; `shift` (3,) is that of all points, in world coordinates."""

    path: str
    json: Path
    tiles: tuple[str, ...]
    heads: tuple[LasHead, ...]
    shift: NDArray[np.float64]
    options: ReadOptions

    @property
    def n_points(self) -> int:
        """Points of all tiles."""
        return sum(head.n_points for head in self.heads)

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields that every tile has."""
        return tuple(name for name in self.heads[0].fields if all(name in head.fields for head in self.heads))

    def pieces(self, names: tuple[str, ...]) -> Iterator[PointCloud]:
        """Yield the points of all tiles, tile after tile in pieces, with some of the fields."""
        for path in self.tiles:
            yield from read_las_pieces(path, self.options, self.shift, names)


def is_result_folder(path: str) -> bool:
    """Return whether a path is a folder with the JSON of a result in it."""
    return Path(path, RESULT_JSON).is_file()


def open_result_folder(path: str, options: ReadOptions = AS_IT_IS) -> ResultFolder:
    """Return a result in tiles, of which only the heads are read, in the unit in which it was classified."""
    tiles = tuple(str(each) for each in sorted(Path(path).iterdir()) if each.suffix.lower() in LAS_SUFFIXES)
    if not tiles:
        raise InputError(f"{path}: no LAS or LAZ tile beside {RESULT_JSON}. Run mapq classify again.")
    unit = stated_unit(Path(path, RESULT_JSON)) if options.unit is None else None
    if unit is not None and (unit == unit[0]).all():  # else it is that of the tiles' own reference system
        options = options.replace(unit=float(unit[0]))
    heads = tuple(read_las_head(tile, options) for tile in tiles)
    for tile, head in zip(tiles, heads, strict=True):
        missing = [name for name in RESULT_FIELDS if name not in head.fields]
        if missing:
            raise InputError(
                f"{tile}: expected a tile of a result, with the field {missing[0]}. Run mapq classify again."
            )
        if not np.array_equal(head.unit, heads[0].unit):
            raise InputError(f"{tile}: its unit differs from that of {tiles[0]}. Classify them with --unit.")
    box = np.array([np.min([head.low for head in heads], axis=0), np.max([head.high for head in heads], axis=0)])
    return ResultFolder(path, Path(path, RESULT_JSON), tiles, heads, choose_shift(box), options)


def thinned(folder: ResultFolder, names: tuple[str, ...], n_most: int) -> PointCloud:
    """Return at most `n_most` of the points as one cloud: every n-th of each piece."""
    step = max(1, -(-folder.n_points // n_most))
    begin, parts = 0, []
    for piece in folder.pieces(names):
        parts.append(piece.take(np.arange(-begin % step, len(piece), step)))
        begin += len(piece)
    return _joined(parts)


def thinned_by_patch(folder: ResultFolder, n_points: Ints, n_most: int) -> PointCloud:
    """Return about `n_most` of the points as one cloud, with the fields of a result; of small patches all of them.

    `n_points` (m,) is that of each patch.
    """
    n_loose = max(folder.n_points - int(n_points.sum()), 0)
    share = n_most // 4 if n_loose > n_most // 4 else n_loose
    step = np.append(steps_of(n_points, n_most - share), max(1, -(-n_loose // max(share, 1))))
    n_before = np.zeros(len(step), np.int64)
    parts = []
    for piece in folder.pieces(RESULT_FIELDS):
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
