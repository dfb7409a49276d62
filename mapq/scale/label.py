"""The result, point by point: each file is read again, in its own order, and written with the labels of its points."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import IO, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.fields import Array
from mapq.io.las_pieces import open_las_pieces
from mapq.io.options import ReadOptions
from mapq.io.ply_write import vertex_rows
from mapq.io.results import result_cloud
from mapq.io.write import LAS_SUFFIXES, write_cloud
from mapq.scale.files import save_arrays
from mapq.scale.patches import load_whole
from mapq.scale.source import Range, Source, read_range
from mapq.scale.spool import Spooled, read_rows
from mapq.scale.tile_files import regions_path
from prf.shell.errors import OutputError
from prf.shell.files import open_output

LABELS = "labels.npz"


class LabelTask(NamedTuple):
    """What the writing of one file of the result is given.

    Attributes
    ----------
    target : str
        File that is written.
    sources : tuple of Source
        Files whose points go there.
    parts : tuple of tuple of Range
        Of each of them.
    spooled : dict of int to Spooled
        What each of these ranges gave.
    starts : dict of (int, int) to int
        By tile and range, where the points of the range begin in the tile's file of regions.
    options, shift, folder
        As the ranges were read with.
    """

    target: str
    sources: tuple[Source, ...]
    parts: tuple[tuple[Range, ...], ...]
    spooled: dict[int, Spooled]
    starts: dict[tuple[int, int], int]
    options: ReadOptions
    shift: NDArray[np.float64]
    folder: str


class Sink(Protocol):
    """What takes pieces of a result."""

    def write(self, cloud: PointCloud) -> None:
        """Append points."""


def save_labels(
    folder: str, label: NDArray[np.uint8], probability: NDArray[np.float32], cause: NDArray[np.uint8] | None
) -> None:
    """Write the labels (m,) of patches, and their causes where these are known, into the work folder."""
    causes = {} if cause is None else {"cause": cause}
    save_arrays(os.path.join(folder, LABELS), label=label, probability=probability, **causes)


def patch_of_range(folder: str, part: Range, spooled: Spooled, starts: dict[tuple[int, int], int]) -> Array:
    """Return the patch (n,) of each point of a range, -1 for none: each from the tile that it belongs to."""
    whole = load_whole(folder)
    out = np.full(part.stop - part.start, -1, np.int32)
    for tile, n_own in zip(spooled.tiles, spooled.n_own, strict=True):
        if n_own:
            begin = starts[tile, part.number]
            region = np.load(regions_path(folder, tile), mmap_mode="r")[begin : begin + n_own]
            number = np.append(whole.number[whole.first_region[tile] : whole.first_region[tile + 1]], np.int32(-1))
            out[read_rows(folder, tile, part.number, n_own)] = number[region]
    return out


def write_labels(task: LabelTask) -> int:
    """Write one file of the result, and return how many points it has."""
    with np.load(os.path.join(task.folder, LABELS)) as arrays:
        label, probability = arrays["label"], arrays["probability"]
        cause = arrays.get("cause")
    n_points = 0
    with _open_sink(task) as sink:
        for source, parts in zip(task.sources, task.parts, strict=True):
            for part in parts:
                patch = patch_of_range(task.folder, part, task.spooled[part.number], task.starts)
                begin = 0
                for piece in read_range(source, task.options, part, task.shift):
                    some = patch[begin : begin + len(piece)]
                    sink.write(result_cloud(piece, some, label, probability, cause))
                    begin += len(piece)
                n_points += begin
    return n_points


@contextmanager
def _open_sink(task: LabelTask) -> Iterator[Sink]:
    """Give what writes the target: in pieces, but for clouds that are read whole."""
    if task.target.lower().endswith(LAS_SUFFIXES) and task.sources[0].is_las:
        with open_las_pieces(task.target) as pieces:
            yield pieces
    elif task.sources[0].is_las:
        with _open_ply(task.target, sum(source.n_points for source in task.sources)) as ply:
            yield ply
    else:
        yield _AtOnce(task.target)


class _AtOnce:
    """A cloud that is one piece."""

    def __init__(self, path: str) -> None:
        self._path = path

    def write(self, cloud: PointCloud) -> None:
        """Write all points."""
        write_cloud(self._path, cloud)


class _Ply:
    """A binary PLY that is being written."""

    def __init__(self, path: str, stream: IO[Any], n_points: int) -> None:
        self._path, self._stream, self._n_points, self._kind = path, stream, n_points, np.dtype([])

    def write(self, cloud: PointCloud) -> None:
        """Append points; the first piece says which properties there are.

        Raises
        ------
        OutputError
            If the fields of another one are others, or hold numbers that do not fit those of the first.
        """
        rows = vertex_rows(replace(cloud, coordinate_type=np.float64), cloud.fields)
        if not self._kind.names:
            self._kind = rows.dtype
            self._stream.write(_ply_header(self._kind, self._n_points))
        # Numpy goes by the order of columns, whatever their names, and wraps numbers that do not fit.
        if rows.dtype.names != self._kind.names:
            raise OutputError(f"{self._path}: {cloud.source} has other fields than the files before. Name a folder.")
        with np.errstate(invalid="ignore"):
            fitted = rows.astype(self._kind)
        for name in self._kind.names or ():
            if rows.dtype[name] == self._kind[name]:
                continue
            if not np.array_equal(rows[name], fitted[name], equal_nan=rows.dtype[name].kind == "f"):
                raise OutputError(
                    f"{self._path}: field {name} of {cloud.source} does not fit the numbers before. Name a folder."
                )
        self._stream.write(fitted.tobytes())


PLY_TYPES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"} | {
    "f4": "float",
    "f8": "double",
}


def _ply_header(kind: np.dtype[Any], n_points: int) -> bytes:
    named = [f"property {PLY_TYPES[kind[name].str[1:]]} {name}" for name in kind.names or ()]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {n_points}", *named, "end_header", ""]
    return "\n".join(lines).encode("ascii")


@contextmanager
def _open_ply(path: str, n_points: int) -> Iterator[_Ply]:
    with open_output(path, binary=True) as stream:
        yield _Ply(path, stream, n_points)
