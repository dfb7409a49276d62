"""The files of a large map, read in pieces."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud, choose_shift
from mapq.configuration import ReadOptions
from mapq.io.clouds import read_cloud
from mapq.io.content import Content
from mapq.io.las import read_las_head, read_las_pieces
from mapq.io.write import LAS_SUFFIXES
from prf.shell.errors import InputError

LAS_MAGIC = b"LASF"


class Source(NamedTuple):
    """One file: LAS is read in pieces, other formats whole."""

    path: str
    is_las: bool
    n_points: int
    low: NDArray[np.float64]  # (3,) box in world coordinates
    high: NDArray[np.float64]  # (3,)
    unit: NDArray[np.float64]  # (3,) metres in a unit of the file
    fields: tuple[str, ...]


class Map(NamedTuple):
    """The files of a map in order, with the shift (3,) of all their points in world coordinates."""

    name: str
    sources: tuple[Source, ...]
    options: ReadOptions
    shift: NDArray[np.float64]

    @property
    def n_points(self) -> int:
        """Points of all files."""
        return sum(source.n_points for source in self.sources)

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields that all files have."""
        first, *others = self.sources
        return tuple(name for name in first.fields if all(name in each.fields for each in others))

    def pieces(self, names: tuple[str, ...] | None = None) -> Iterator[tuple[int, PointCloud]]:
        """Yield the points in order, with the number of their file; with some of the fields (None: all)."""
        for number, source in enumerate(self.sources):
            if source.is_las:
                for piece in read_las_pieces(source.path, self.options, self.shift, names):
                    yield number, piece
                continue
            cloud = read_cloud(source.path, self.options)
            xyz = (cloud.world() - self.shift) * cloud.unit
            fields = {name: values for name, values in cloud.fields.items() if names is None or name in names}
            yield (
                number,
                PointCloud(xyz, self.shift, fields, cloud.coordinate_type, cloud.source, cloud.unit, cloud.las_header),
            )


def is_tiled(path: str) -> bool:
    """Return whether a path is a folder of LAS or LAZ files."""
    folder = Path(path)
    return folder.is_dir() and any(each.suffix.lower() in LAS_SUFFIXES for each in folder.iterdir())


def open_map(path: str, options: ReadOptions) -> Map:
    """Return a map: the LAS and LAZ files of a folder by name, or one file of any format.

    Raises InputError if a file cannot be read, or they have different units.
    """
    paths = [path]
    if is_tiled(path):
        paths = [str(each) for each in sorted(Path(path).iterdir()) if each.suffix.lower() in LAS_SUFFIXES]
    sources = tuple(_look_at(each, options) for each in paths)
    for other in sources[1:]:
        if not np.array_equal(other.unit, sources[0].unit):
            raise InputError(f"{other.path}: its unit is not that of {sources[0].path}. Give it with --unit.")
    low, high = (
        each([getattr(s, name) for s in sources], axis=0) for each, name in ((np.min, "low"), (np.max, "high"))
    )
    return Map(path, sources, options, choose_shift(np.array([low, high])))


def _look_at(path: str, options: ReadOptions) -> Source:
    if Content(path).head.startswith(LAS_MAGIC):
        head = read_las_head(path, options)
        return Source(path, True, head.n_points, head.low, head.high, head.unit, head.fields)
    cloud = read_cloud(path, options)
    world = cloud.world()[cloud.finite()]
    return Source(path, False, len(cloud), world.min(axis=0), world.max(axis=0), cloud.unit, tuple(cloud.fields))


Array = NDArray[Any]


class WorkFolder(NamedTuple):
    """Points in files, a record a point: `xyz`, `number` among all points of the map, and fields as float64."""

    folder: str
    fields: tuple[str, ...]

    @property
    def record(self) -> np.dtype[Any]:
        """The type of a record."""
        return np.dtype([("xyz", "<f8", 3), ("number", "<i8"), *((name, "<f8") for name in self.fields)])

    def path(self, kind: str, tile: int) -> str:
        """Return the file of a tile: ``spool``, ``points`` or ``border``."""
        return os.path.join(self.folder, f"{kind}_{tile:05d}")

    def append(self, tile: int, records: Array) -> None:
        """Add points to the spool of a tile."""
        with open(self.path("spool", tile), "ab") as stream:
            stream.write(records.tobytes())

    def spooled(self, tile: int) -> Array:
        """Return the points of a tile in the order in which they were read."""
        path = self.path("spool", tile)
        if not os.path.exists(path):
            return np.zeros(0, self.record)
        return np.memmap(path, self.record, "r")

    def write_points(self, tile: int, records: Array) -> None:
        """Write the points of a tile, region after region."""
        with open(self.path("points", tile), "wb") as stream:
            stream.write(records.tobytes())

    def points(self, slices: NDArray[np.int64]) -> list[Array]:
        """Return points of tiles by slices (s, 4): tile, begin, end, step."""
        files = {tile: np.memmap(self.path("points", tile), self.record, "r") for tile in set(slices[:, 0].tolist())}
        return [files[tile][begin:end:step] for tile, begin, end, step in slices.tolist()]
