"""LAS and LAZ, COPC among them, with laspy (the extra `las`): at once, or a piece at a time."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content, damage_in_one_line
from mapq.io.fields import Array, check_coordinates, cloud_of_world, warn_dropped
from mapq.io.las_unit import SYSTEM_USER, unit_of
from prf.shell.errors import InputError, require

if TYPE_CHECKING:
    from laspy import LasHeader, LasReader, ScaleAwarePointRecord

logger = logging.getLogger(__name__)
logging.getLogger("laspy").addHandler(logging.NullHandler())  # what it logs, the error reports

PIECE = 1_000_000
"""Points of a piece."""

RAW = ("X", "Y", "Z")
WITHHELD = "withheld"
"""Flag of points that, LAS states, should not be included in processing."""

LAYERED_WAVES = (9, 10)
"""Point formats whose wave packets lazrs does not decompress correctly (0.8.2)."""
WAVES = ("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location", "x_t", "y_t", "z_t")

MOST_RECORDS = 1 << 12
"""Variable length records; laspy would read four thousand million of a damaged header."""


class LasHead(NamedTuple):
    """What the head of a LAS file states.

    Box (3,) of the points in world coordinates, metres (3,) in a unit of these, header and records as
    `PointCloud.las_header`, and names of the fields without the coordinates.
    """

    n_points: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    unit: NDArray[np.float64]
    header: bytes
    fields: tuple[str, ...]


def read_las(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a LAS or LAZ file, with its header for a result in LAS.

    Coordinates are the integers of the file times its scale plus its offset, in float64. Dimensions keep the names of
    laspy; scaled extra ones become float64.
    """
    with _opened(content) as (reader, stream):
        head = _head(reader.header, stream, content.source, options)
        points = _next(reader, head.n_points, content.source)
        world = _world(points, reader.header)
        fields = {name: np.array(points[name]) for name in head.fields}
    if WITHHELD in fields and fields[WITHHELD].any():
        n_withheld = np.count_nonzero(fields[WITHHELD])
        logger.warning("%s: %d points are marked withheld, but used. Remove them first", content.source, n_withheld)
    cloud = cloud_of_world(world, fields, content.source, head.unit)
    return PointCloud(cloud.xyz, cloud.shift, cloud.fields, np.float64, content.source, cloud.unit, head.header)


def read_las_head(path: str, options: ReadOptions) -> LasHead:
    """Return what the head of a LAS or LAZ file states."""
    content = Content(path)
    with damage_in_one_line(path), _opened(content) as (reader, stream):
        return _head(reader.header, stream, path, options)


def read_las_pieces(
    path: str, options: ReadOptions, shift: NDArray[np.float64], names: tuple[str, ...] | None = None
) -> Iterator[PointCloud]:
    """Yield the points of a file in pieces of at most `PIECE`, with this shift (3,).

    `names` are the fields to read, as far as they exist; by default all.
    """
    with damage_in_one_line(path), _opened(Content(path)) as (reader, stream):
        head = _head(reader.header, stream, path, options)
        wanted = [name for name in head.fields if names is None or name in names]
        for first in range(0, head.n_points, PIECE):
            points = _next(reader, min(PIECE, head.n_points - first), path)
            world = _world(points, reader.header)
            check_coordinates(world, path)
            fields = {name: np.array(points[name]) for name in wanted}
            yield PointCloud((world - shift) * head.unit, shift, fields, np.float64, path, head.unit, head.header)


@contextmanager
def _opened(content: Content) -> Iterator[tuple[LasReader, BinaryIO]]:
    laspy = require("laspy", "las", f"{content.source}: LAS", InputError)
    with content.stream() as stream:
        n_records = int.from_bytes(stream.read(104)[100:], "little")
        if n_records > MOST_RECORDS:
            raise InputError(f"{content.source}: damaged: {n_records} records in the LAS header. Copy it again.")
        stream.seek(0)
        with laspy.LasReader(stream, closefd=False, read_evlrs=True) as reader:
            yield reader, stream


def _head(header: LasHeader, stream: BinaryIO, source: str, options: ReadOptions) -> LasHead:
    if header.point_count == 0:
        raise InputError(f"{source}: no points. Check how the file was written.")
    left_out: tuple[str, ...] = RAW
    if header.are_points_compressed and header.point_format.id in LAYERED_WAVES:
        warn_dropped(WAVES, source, "they cannot be decompressed reliably")
        left_out = (*RAW, *WAVES)
    names = [name for name in header.point_format.dimension_names if name not in left_out]
    stored = _stored_head(header, stream)
    unit = np.array(np.broadcast_to(options.unit or unit_of(header.vlrs, source), 3), np.float64)
    low, high = np.asarray(header.mins, np.float64), np.asarray(header.maxs, np.float64)
    return LasHead(int(header.point_count), low, high, unit, stored, tuple(names))


def _stored_head(header: LasHeader, stream: BinaryIO) -> bytes:
    """Return header and records up to the points; a reference system behind these (EVLR) is moved before them."""
    late = [record for record in header.evlrs or () if record.user_id == SYSTEM_USER]
    if not late:
        place = stream.tell()
        stream.seek(0)
        stored = stream.read(header.offset_to_point_data)
        stream.seek(place)
        return stored
    head = io.BytesIO()
    header.vlrs += late
    header.evlrs = [record for record in header.evlrs if record.user_id != SYSTEM_USER]
    header.write_to(head, encoding_errors="ignore")
    return head.getvalue()


def _next(reader: LasReader, n_points: int, source: str) -> ScaleAwarePointRecord:
    points = reader.read_points(n_points)
    if len(points) != n_points:
        raise InputError(f"{source}: cut off: {n_points} points are promised, {len(points)} follow. Copy it again.")
    return points


def _world(points: ScaleAwarePointRecord, header: LasHeader) -> Array:
    """Return the world coordinates (n, 3) of points."""
    whole = np.column_stack([np.asarray(points[axis]) for axis in RAW])
    return np.asarray(whole * header.scales + header.offsets)
