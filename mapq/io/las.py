"""LAS and LAZ, COPC among them, with laspy: at once, or a piece at a time."""

from __future__ import annotations

import io
import logging
import re
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content, damage_in_one_line
from mapq.io.fields import Array, check_coordinates, cloud_of_world, warn_dropped
from prf.shell.errors import InputError

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


SYSTEM_USER = "LASF_Projection"
"""Of records with a reference system."""


class CloudHead(NamedTuple):
    """What is known of a file of points before they are read."""

    path: str
    n_points: int
    low: NDArray[np.float64]  # (3,) box in world coordinates
    high: NDArray[np.float64]  # (3,)
    unit: NDArray[np.float64]  # (3,) metres in a unit of these
    fields: tuple[str, ...]  # without the coordinates
    las_header: bytes = b""  # as `PointCloud.las_header`; empty for other formats


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
    return PointCloud(cloud.xyz, cloud.shift, cloud.fields, np.float64, content.source, cloud.unit, head.las_header)


def read_las_head(path: str, options: ReadOptions) -> CloudHead:
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
            yield PointCloud((world - shift) * head.unit, shift, fields, np.float64, path, head.unit, head.las_header)


@contextmanager
def _opened(content: Content) -> Iterator[tuple[LasReader, BinaryIO]]:
    import laspy  # noqa: PLC0415 - a tenth of a second, for LAS alone

    with content.stream() as stream:
        n_records = int.from_bytes(stream.read(104)[100:], "little")
        if n_records > MOST_RECORDS:
            raise InputError(f"{content.source}: damaged: {n_records} records in the LAS header. Copy it again.")
        stream.seek(0)
        with laspy.LasReader(stream, closefd=False, read_evlrs=True) as reader:
            yield reader, stream


def _head(header: LasHeader, stream: BinaryIO, source: str, options: ReadOptions) -> CloudHead:
    if header.point_count == 0:
        raise InputError(f"{source}: no points. Check how the file was written.")
    left_out: tuple[str, ...] = RAW
    if header.are_points_compressed and header.point_format.id in LAYERED_WAVES:
        warn_dropped(WAVES, source, "they cannot be decompressed reliably")
        left_out = (*RAW, *WAVES)
    names = [name for name in header.point_format.dimension_names if name not in left_out]
    stored = _stored_head(header, stream)
    unit = np.array(np.broadcast_to(options.unit or _unit_of(header.vlrs, source), 3), np.float64)
    low, high = np.asarray(header.mins, np.float64), np.asarray(header.maxs, np.float64)
    return CloudHead(source, int(header.point_count), low, high, unit, tuple(names), stored)


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


WKT, GEO_KEYS = 2112, 34735
"""Records of that user that are read here."""
MODEL_TYPE, LINEAR_UNITS, VERTICAL_UNITS = 1024, 3076, 4099
GEOGRAPHIC = 2
"""Model type of degrees."""
EPSG_UNITS = {
    **{9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0, 9005: 0.3047972654, 9036: 1000.0, 9096: 0.9144},
    **{1025: 0.001, 1033: 0.01},
}
"""Metres in the units of point clouds, by their EPSG codes."""

LEVEL = ("PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS")
UPRIGHT = ("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS")
ANGLES = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS")
OTHER = ("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS")
"""Kinds of systems of a WKT, in the spellings of both versions and of ESRI."""

_SYSTEM = re.compile(rf"\b({'|'.join((*LEVEL, *UPRIGHT, *ANGLES, *OTHER))})\s*\[", re.IGNORECASE)
_UNIT = re.compile(r'\b(?:LENGTH)?UNIT\s*\[\s*"[^"]*"\s*,\s*(\d[-+.\deE]*)', re.IGNORECASE)


def _unit_of(records: Iterable[Any], source: str) -> NDArray[np.float64]:
    """Return the metres (3,) in a unit of x, y and z; 1 where the records do not state it.

    Parameters
    ----------
    records : iterable of VLR
        As laspy makes them. A WKT counts before GeoTIFF keys.
    source : str
        Name of the file, for messages.
    """
    bodies = {
        int(record.record_id): bytes(record.record_data_bytes()) for record in records if record.user_id == SYSTEM_USER
    }
    if WKT in bodies:
        level, upright, is_geographic = _of_wkt(bodies[WKT].decode("utf-8", "replace"))
    else:
        level, upright, is_geographic = _of_keys(bodies.get(GEO_KEYS, b""), source)
    if is_geographic:
        raise InputError(
            f"{source}: x and y are degrees of longitude and latitude. Project the cloud to a grid in metres first."
        )
    level = 1.0 if level is None else level
    unit = np.array([level, level, level if upright is None else upright])
    if (unit != 1.0).any():
        logger.info("%s: x and y are in units of %g m, z of %g m; lengths are in metres", source, unit[0], unit[2])
    return unit


def _of_wkt(text: str) -> tuple[float | None, float | None, bool]:
    """Return metres in a unit of x and y and in one of z, None where not stated, and whether x and y are degrees.

    The unit of a system is the last one in it, behind those of the systems that it is built on.
    """
    found: dict[str, float | None] = {}
    for match in _SYSTEM.finditer(text):
        units = _UNIT.findall(_bracketed(text, match.end() - 1))
        found.setdefault(match[1].upper(), float(units[-1]) if units else None)

    def unit(kinds: tuple[str, ...]) -> float | None:
        return next((found[kind] for kind in kinds if found.get(kind) is not None), None)

    is_level = any(kind in found for kind in (*LEVEL, *OTHER))
    is_geographic = not is_level and any(kind in found for kind in ANGLES) and "cartesian" not in text.lower()
    return unit((*LEVEL, *OTHER)), unit(UPRIGHT), is_geographic


def _bracketed(text: str, start: int) -> str:
    """Return the content of the bracket that opens at `start`."""
    depth = 0
    for place in range(start, len(text)):
        depth += {"[": 1, "]": -1}.get(text[place], 0)
        if depth == 0:
            return text[start:place]
    return text[start:]


def _of_keys(body: bytes, source: str) -> tuple[float | None, float | None, bool]:
    """Return what :func:`_of_wkt` does, of a directory of GeoTIFF keys."""
    rows = struct.iter_unpack("<4H", body[8 : len(body) // 8 * 8])
    keys = {key: value for key, location, _, value in rows if location == 0}
    codes = [keys.get(key, 0) for key in (LINEAR_UNITS, VERTICAL_UNITS)]
    for code in codes:
        if code and code not in EPSG_UNITS:
            logger.warning("%s: the unit of length of code %d is not known; give it with --unit", source, code)
    level, upright = (EPSG_UNITS.get(code) for code in codes)
    return level, upright, keys.get(MODEL_TYPE) == GEOGRAPHIC
