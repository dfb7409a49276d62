"""LAS and LAZ a piece at a time: maps that do not fit into memory are read, and results written, so."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE
from mapq.io.las import RAW, check_head, field_names, next_points, refusing_damage, scale_and_offset, stored_head
from mapq.io.las_unit import unit_of
from mapq.io.las_write import LARGEST_INTEGER, columns_of_cloud, old_header, packed_record, refusing_full_disk
from mapq.io.laz_chunks import check_chunks
from mapq.io.options import ReadOptions
from mapq.io.panics import panics_unheard
from prf.shell.errors import InputError, OutputError
from prf.shell.files import open_output

if TYPE_CHECKING:
    from laspy import LasHeader, LasWriter
    from laspy.point.record import PackedPointRecord

PIECE = 1_000_000
"""Points of a piece."""


class LasHead(NamedTuple):
    """What the head of a LAS file says.

    Attributes
    ----------
    n_points : int
    low, high : (3,) float64
        Box of the points in world coordinates, as promised.
    unit : (3,) float64
        Metres in a unit of the file.
    header : bytes
        Header and records, as `PointCloud.las_header`.
    fields : tuple of str
        Names of the fields, coordinates not among them.
    """

    n_points: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    unit: NDArray[np.float64]
    header: bytes
    fields: tuple[str, ...]


def read_las_head(path: str, options: ReadOptions) -> LasHead:
    """Return what the head of a LAS or LAZ file says; its chunks are checked too.

    Raises
    ------
    InputError
        As :func:`mapq.io.las.read_las`, as far as head and chunks show it.
    """
    content = Content(path)
    with content.stream() as stream, refusing_damage(path):
        check_head(stream, path)
        from laspy import LasHeader  # noqa: PLC0415 - takes a fifth of a second

        head = LasHeader.read_from(stream)
        if head.are_points_compressed:
            check_chunks(stream, head, path)
        stored = stored_head(stream, head)
        unit = np.broadcast_to(np.asarray(options.unit or unit_of(head.vlrs, path), np.float64), 3)
        low, high = np.asarray(head.mins, np.float64), np.asarray(head.maxs, np.float64)
        return LasHead(int(head.point_count), low, high, unit, stored, tuple(field_names(head, path)))


def read_las_pieces(
    path: str,
    options: ReadOptions,
    start: int,
    stop: int,
    shift: NDArray[np.float64],
    names: tuple[str, ...] | None = None,
) -> Iterator[PointCloud]:
    """Yield the points from `start` to `stop` in pieces of at most `PIECE`.

    Parameters
    ----------
    path : str
    options : ReadOptions
    start, stop : int
    shift : (3,) float64
        Of the clouds, in world coordinates.
    names : tuple of str, optional
        Fields that are read, as far as there are such; all if absent.

    Raises
    ------
    InputError
        If the file is damaged or cut off.
    """
    from laspy import DecompressionSelection, LasReader, LazBackend  # noqa: PLC0415

    head = read_las_head(path, options)
    wanted = head.fields if names is None else tuple(name for name in head.fields if name in names)
    selection = DecompressionSelection.all()
    if set(wanted) <= {"gps_time", "point_source_id"}:
        selection = DecompressionSelection.base().decompress_z()
        if "gps_time" in wanted:
            selection = selection.decompress_gps_time()
        if "point_source_id" in wanted:
            selection = selection.decompress_point_source_id()
    with (
        Content(path).stream() as stream,
        refusing_damage(path),
        LasReader(
            stream, closefd=False, laz_backend=LazBackend.Lazrs, read_evlrs=False, decompression_selection=selection
        ) as reader,
    ):
        scales, offsets = scale_and_offset(reader.header, path)
        with panics_unheard():  # it decompresses what stands before
            reader.seek(start)
        for first in range(start, stop, PIECE):
            n_points = min(PIECE, stop - first)
            points = next_points(reader, n_points)
            if len(points) != n_points:
                raise InputError(f"{path}: cut off after {first + len(points)} points. Copy or download it again.")
            with np.errstate(over="ignore", invalid="ignore"):  # of scales beyond reason
                world = np.column_stack([np.asarray(points[axis]) for axis in RAW]) * scales + offsets
                fields = {name: np.array(points[name]) for name in wanted}
            if not np.abs(world).max() <= LARGEST_COORDINATE:
                raise InputError(f"{path}: a coordinate lies beyond {LARGEST_COORDINATE:g}. Remove such points.")
            yield PointCloud((world - shift) * head.unit, shift, fields, np.float64, path, head.unit, head.header)


class LasPieces:
    """A LAS file that is being written, under the header of the first piece; see :func:`open_las_pieces`."""

    def __init__(self, path: str, stream: IO[Any]) -> None:
        self._path, self._stream = path, stream
        self._writer: LasWriter | None = None
        self._names: set[str] = set()
        self._scales: dict[str, str] = {}

    def write(self, cloud: PointCloud) -> None:
        """Append points; all pieces have the same fields.

        Raises
        ------
        OutputError
            If their fields or coordinates do not fit those of the first piece.
        """
        from laspy import LasWriter  # noqa: PLC0415

        header = old_header(cloud)
        columns = columns_of_cloud(cloud, header)
        if self._writer is None:
            compress = self._path.lower().endswith(".laz")
            self._writer = LasWriter(self._stream, header, compress, closefd=False, encoding_errors="ignore")
            self._names, self._scales = set(columns), _scales_of(header)
        if set(columns) != self._names:
            raise OutputError(f"{self._path}: {cloud.source} has other fields than the files before. Name a folder.")
        scales, header = _scales_of(header), self._writer.header
        whole = np.rint((cloud.world() - header.offsets) / header.scales)
        if len(whole) and (whole.max() > LARGEST_INTEGER or whole.min() < -LARGEST_INTEGER - 1):
            raise OutputError(f"{self._path}: the coordinates do not fit the scale of the first file. Name a folder.")
        record = packed_record(header, whole, columns)
        for name, values in columns.items():
            # In a narrower type, or under another scale, they would be read as other numbers.
            if scales.get(name) != self._scales.get(name) or not _is_kept(record, name, values):
                raise OutputError(
                    f"{self._path}: field {name} of {cloud.source} does not fit those before. Name a folder."
                )
        self._writer.write_points(record)

    def close(self) -> None:
        """Write what belongs behind the points."""
        if self._writer is not None:
            self._writer.close()


def _scales_of(header: LasHeader) -> dict[str, str]:
    """Return by which scale and offset the numbers of a file's own dimensions are to be read."""
    return {item.name: f"{item.scales} {item.offsets}" for item in header.point_format.extra_dimensions}


def _is_kept(record: PackedPointRecord, name: str, values: NDArray[Any]) -> bool:
    """Return whether a record holds the values (n,) of a dimension as they are."""
    stored = record.array[name] if name in record.array.dtype.names else np.asarray(record[name])
    return np.array_equal(stored, values, equal_nan=values.dtype.kind == "f")


@contextmanager
def open_las_pieces(path: str | os.PathLike[str]) -> Iterator[LasPieces]:
    """Give a LAS file, LAZ if the name ends so, to be written piece by piece, whole or not at all.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    with open_output(path, binary=True) as stream, refusing_full_disk(path):
        pieces = LasPieces(os.fspath(path), stream)
        yield pieces
        pieces.close()
