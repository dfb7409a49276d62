"""Where the points of a large map come from: files, and ranges of points in them that one task each reads."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud, choose_shift
from mapq.io.clouds import read_cloud
from mapq.io.content import Content
from mapq.io.las_pieces import read_las_head, read_las_pieces
from mapq.io.options import ReadOptions
from mapq.io.write import LAS_SUFFIXES
from prf.shell.errors import InputError

RANGE = 2_000_000
"""Points of a range at most: a task reads so many, and holds them."""
LAS_MAGIC = b"LASF"


class Source(NamedTuple):
    """One file.

    Attributes
    ----------
    path : str
    is_las : bool
        Read in pieces; other formats are read whole, whenever a range of them is.
    n_points : int
    low, high : (3,) float64
        Box in world coordinates, as the head of the file promises.
    unit : (3,) float64
        Metres in a unit of the file.
    fields : tuple of str
    """

    path: str
    is_las: bool
    n_points: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    unit: NDArray[np.float64]
    fields: tuple[str, ...]


class Range(NamedTuple):
    """Points `start` to `stop` of a file (its place among the files), whose first one is number `base` of all."""

    number: int
    file: int
    start: int
    stop: int
    base: int


def is_tiled(path: str) -> bool:
    """Return whether a path is a folder of LAS or LAZ tiles."""
    folder = Path(path)
    return folder.is_dir() and any(each.suffix.lower() in LAS_SUFFIXES for each in folder.iterdir())


def find_sources(path: str, options: ReadOptions) -> list[Source]:
    """Return the files of a map: the LAS and LAZ files of a folder by name, or one file of any format.

    Raises
    ------
    InputError
        If one cannot be read, or they have different units.
    """
    folder = Path(path)
    paths = [path]
    if is_tiled(path):
        paths = [str(each) for each in sorted(folder.iterdir()) if each.suffix.lower() in LAS_SUFFIXES]
    sources = [_look_at(each, options) for each in paths]
    for other in sources[1:]:
        if not np.array_equal(other.unit, sources[0].unit):
            raise InputError(f"{other.path}: its unit is not that of {sources[0].path}. Say which with --unit.")
    return sources


def _look_at(path: str, options: ReadOptions) -> Source:
    content = Content(path)
    if content.head.startswith(LAS_MAGIC):
        head = read_las_head(path, options)
        return Source(path, True, head.n_points, head.low, head.high, head.unit, head.fields)
    cloud = read_cloud(path, options)
    world = cloud.world()[cloud.finite()]
    low, high = world.min(axis=0), world.max(axis=0)
    return Source(path, False, len(cloud), low, high, cloud.unit, tuple(cloud.fields))


def cut_ranges(sources: list[Source], largest: int = RANGE) -> list[Range]:
    """Return the ranges of all files; only those of LAS are read in several."""
    ranges: list[Range] = []
    base = 0
    for file, source in enumerate(sources):
        step = largest if source.is_las else max(source.n_points, 1)
        for start in range(0, source.n_points, step):
            stop = min(start + step, source.n_points)
            ranges.append(Range(len(ranges), file, start, stop, base + start))
        base += source.n_points
    return ranges


def common_shift(sources: list[Source]) -> NDArray[np.float64]:
    """Return the shift (3,) of the whole map, in world coordinates."""
    return choose_shift(
        np.array([np.min([each.low for each in sources], axis=0), np.max([each.high for each in sources], axis=0)])
    )


def read_range(
    source: Source,
    options: ReadOptions,
    part: Range,
    shift: NDArray[np.float64],
    names: tuple[str, ...] | None = None,
) -> Iterator[PointCloud]:
    """Yield the points of a range in pieces, with the fields of `names` (None: all); errors as of the readers."""
    if source.is_las:
        yield from read_las_pieces(source.path, options, part.start, part.stop, shift, names)
        return
    cloud = read_cloud(source.path, options)
    xyz = (cloud.world() - shift) * cloud.unit
    kept = {name: values for name, values in cloud.fields.items() if names is None or name in names}
    yield PointCloud(xyz, shift, kept, cloud.coordinate_type, cloud.source, cloud.unit, cloud.las_header)
