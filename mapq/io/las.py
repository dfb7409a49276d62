"""LAS and LAZ, COPC among them, read piece by piece with laspy."""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.content import Content
from mapq.io.fields import Array, cloud_of_world, refuse_doubles
from mapq.io.las_unit import SYSTEM_USER, unit_of
from mapq.io.laz_chunks import check_chunks
from mapq.io.options import ReadOptions
from mapq.io.panics import panics_unheard
from prf.shell.errors import InputError

if TYPE_CHECKING:
    from laspy import VLR, LasHeader, LasReader, ScaleAwarePointRecord

logger = logging.getLogger(__name__)

CHUNK = 200_000
"""Points that are decoded at once, usually some 10 MB, ..."""

PIECE = 1 << 26
"""... and bytes of them at most: a header may promise points of any length."""

NEWEST = 5
"""Minor version of LAS."""

LARGEST_CHUNK = 1_000_000
"""Points of a chunk of LAZ up to which several are decoded at once; usual are 50,000."""

LONGEST_HEAD = 1 << 26
"""Bytes of header and records before the points; a file that promises more is damaged."""

MOST_RECORDS = 1 << 12
"""Variable length records, of either kind."""

LATE_HEAD = 60
"""Bytes before the content of a record behind the points."""
LONGEST_RECORD = 65_535
"""Bytes of a record before the points."""

RAW = ("X", "Y", "Z")
WITHHELD = "withheld"
"""Flag of points that, LAS says, should not be included in processing."""

LAYERED_WAVES = (9, 10)
"""Point formats whose wave packets lazrs does not give back from LAZ as they were (0.8.2)."""
WAVES = ("wavepacket_index", "wavepacket_offset", "wavepacket_size", "return_point_wave_location", "x_t", "y_t", "z_t")

DAMAGE = (ValueError, TypeError, LookupError, OverflowError, EOFError, OSError, ArithmeticError, AttributeError)
"""What laspy raises for a damaged file, beside its own errors and those of its decompressor."""


def read_las(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a LAS or LAZ file, with its header for a result in LAS.

    Coordinates are the integers of the file times its scale plus its offset, in float64. Dimensions keep the names of
    laspy; scaled extra ones become float64.

    Raises
    ------
    InputError
        If the file is damaged, cut off, of a version that cannot be read, or has no points.
    """
    source = content.source
    with content.stream() as stream, refusing_damage(source):
        check_head(stream, source)
        from laspy import LasHeader, LasReader, LazBackend  # noqa: PLC0415 - takes a fifth of a second

        head = LasHeader.read_from(stream)
        largest = check_chunks(stream, head, source) if head.are_points_compressed else 0
        stream.seek(0)
        # Several threads hold several whole chunks.
        backend = LazBackend.LazrsParallel if largest <= LARGEST_CHUNK else LazBackend.Lazrs
        with LasReader(stream, closefd=False, laz_backend=backend, read_evlrs=False) as reader:
            world, fields = _read_points(reader, source)
            stored = stored_head(stream, reader.header)
            unit = options.unit or unit_of(reader.header.vlrs, source)
    n_withheld = int(np.count_nonzero(fields[WITHHELD])) if WITHHELD in fields else 0
    if n_withheld:
        logger.warning(
            "%s: %d points are marked withheld, which is as good as deleted; they are taken like the others. Remove "
            "them first",
            source,
            n_withheld,
        )
    cloud = cloud_of_world(world, fields, source, unit)
    return PointCloud(cloud.xyz, cloud.shift, cloud.fields, np.float64, source, cloud.unit, stored)


def check_head(stream: BinaryIO, source: str) -> None:
    """Refuse counts and places that the file cannot hold, before laspy believes them."""
    head = stream.read(375)
    size = stream.seek(0, 2)
    stream.seek(0)
    if len(head) < 227:
        raise InputError(f"{source}: cut off within the LAS header. Copy or download the file again.")
    start, n_records, kind, length, n_points = struct.unpack_from("<IIBHI", head, 96)
    if head[24] != 1 or head[25] > NEWEST:
        raise InputError(f"{source}: LAS {head[24]}.{head[25]} is not known; 1.0 to 1.{NEWEST} are. Write it as 1.4.")
    if head[25] >= 4:
        if len(head) < 375:
            raise InputError(f"{source}: cut off within the LAS header. Copy or download the file again.")
        (n_points,) = struct.unpack_from("<Q", head, 247)
    if not 227 <= start <= min(size, LONGEST_HEAD) or n_records > MOST_RECORDS:
        raise InputError(
            f"{source}: damaged: the LAS header promises {n_records} records and points from byte {start} on, the file "
            f"has {size} bytes. Copy or download it again."
        )
    if n_points == 0:
        raise InputError(f"{source}: no points. Check how the file was written.")
    is_compressed = kind >= 128
    if not is_compressed and n_points * length > size - start:
        raise InputError(
            f"{source}: cut off: {n_points} points of {length} bytes are promised, {size - start} bytes follow. "
            f"Copy or download the file again."
        )


def _read_points(reader: LasReader, source: str) -> tuple[NDArray[np.float64], dict[str, Array]]:
    """Return world coordinates (n, 3) and all other dimensions.

    What a header of LAZ promises is believed point by point, as they come: the pieces are joined at the end.
    """
    names = field_names(reader.header, source)
    scales, offsets = scale_and_offset(reader.header, source)
    pieces: dict[str, list[Array]] = {name: [] for name in names}
    places: list[NDArray[np.float64]] = []
    n_piece = max(1, min(CHUNK, PIECE // reader.header.point_format.size))
    while len(points := next_points(reader, n_piece)):
        whole = np.column_stack([np.asarray(points[axis]) for axis in RAW])
        places.append(whole * scales + offsets)
        for name in names:
            pieces[name].append(np.array(points[name]))
    n_points = sum(map(len, places))
    if n_points != reader.header.point_count:
        raise InputError(
            f"{source}: cut off: {reader.header.point_count} points are promised, {n_points} follow. Copy or download "
            f"the file again."
        )
    world = _joined(places)
    return world, {name: _joined(pieces[name]) for name in names}


def next_points(reader: LasReader, n_points: int) -> ScaleAwarePointRecord:
    """Return the next points, at most `n_points`; a panic of the decompressor is an exception, and nothing else."""
    with panics_unheard():
        return reader.read_points(n_points)


def field_names(header: LasHeader, source: str) -> list[str]:
    """Return the dimensions that are read as fields: all but the coordinates, and those that cannot be trusted."""
    left_out: tuple[str, ...] = RAW
    if header.are_points_compressed and header.point_format.id in LAYERED_WAVES:
        logger.warning("%s: fields of wave packets are dropped: they cannot be decompressed reliably", source)
        left_out = (*RAW, *WAVES)
    names = [name for name in header.point_format.dimension_names if name not in left_out]
    refuse_doubles(names, source)
    return names


def scale_and_offset(header: LasHeader, source: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return scale (3,) and offset (3,) of the integers of a file, refusing what is no number."""
    scales, offsets = np.asarray(header.scales), np.asarray(header.offsets)
    if not (np.isfinite(scales).all() and np.isfinite(offsets).all() and (scales > 0.0).all()):
        raise InputError(f"{source}: damaged: scale or offset of the LAS header is no number. Copy the file again.")
    return scales, offsets


def _joined(parts: list[Array]) -> Array:
    """Return the parts as one array, and let go of them."""
    whole = np.concatenate(parts)
    parts.clear()
    return whole


def stored_head(stream: BinaryIO, header: LasHeader) -> bytes:
    """Return header and records of a LAS file, up to its points.

    A reference system that stands behind the points (EVLR) is taken among the records before them, in `header` too.
    """
    found = _late_systems(stream, header)
    if not found:
        stream.seek(0)
        return stream.read(header.offset_to_point_data)
    header.vlrs += found
    header.number_of_evlrs -= len(found)
    head = io.BytesIO()
    header.write_to(head, encoding_errors="ignore")
    return head.getvalue()


def _late_systems(stream: BinaryIO, header: LasHeader) -> list[VLR]:
    """Return the records behind the points that tell the reference system, as far as such records can be read."""
    from laspy.vlrs import VLR  # noqa: PLC0415

    found = []
    place = header.start_of_first_evlr
    for _ in range(min(header.number_of_evlrs, MOST_RECORDS)):
        stream.seek(place)
        head = stream.read(LATE_HEAD)
        if len(head) < LATE_HEAD:
            break
        kind, length = struct.unpack_from("<HQ", head, 18)
        if head[2:18].rstrip(b"\0") == SYSTEM_USER.encode() and length <= LONGEST_RECORD:
            found.append(VLR(SYSTEM_USER, kind, "", stream.read(length)))
        place += LATE_HEAD + length
    return found


@contextmanager
def refusing_damage(source: str) -> Iterator[None]:
    """Turn whatever laspy and its decompressor stumble on into one line."""
    try:
        yield
    except (InputError, MemoryError, KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        if not _is_damage(error):
            raise
        words = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{source}: the LAS file is damaged, or of a version that cannot be read ({words}). Copy or download it "
            f"again."
        ) from error


def _is_damage(error: BaseException) -> bool:
    """Return whether an error is one of reading; a panic of lazrs is no `Exception`, and has no importable name."""
    if isinstance(error, (*DAMAGE, struct.error)):
        return True
    return type(error).__module__.partition(".")[0] in ("laspy", "lazrs", "pyo3_runtime")
