"""Writing a cloud as LAS or LAZ, under the header of the LAS file that it came from if it did."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.fields import Array
from mapq.io.free_names import free_name, scalar_columns
from mapq.io.las import LAYERED_WAVES, refusing_damage
from prf.shell.errors import OutputError
from prf.shell.files import open_output

if TYPE_CHECKING:
    from laspy import LasHeader
    from laspy.point.dims import DimensionInfo
    from laspy.point.record import PackedPointRecord

logger = logging.getLogger(__name__)

FRESH_FORMAT = 7
"""Point format of clouds that are not from LAS: that of LAS 1.4 with time and colours."""
WITH_COLOURS = {0: 2, 1: 3, 4: 5, 6: 7, 9: 10}
"""Point format that has colours besides, of one that has none."""
COLOURS = ("red", "green", "blue")
TO_16_BITS = 257
"""Takes 0 to 255 to 0 to 65,535."""

FINEST = 1e-4
"""Metres: the scale of clouds that are not from LAS, if they are not too large for it."""
LARGEST_INTEGER = 2**31 - 1

LONGEST_NAME = 32
"""Bytes of the name of an extra dimension."""

CHUNK = 1_000_000

REMADE = ("LasZipVlr", "ExtraBytesVlr")
"""Records that laspy makes anew."""
COPC = "copc"
"""User of the records that index the points of COPC: they do not hold for points in another file."""
RESERVED = ("x", "y", "z", "X", "Y", "Z")


def write_las(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud as LAS, compressed if the name ends on .laz, whole or not at all.

    A cloud from LAS keeps version, scale, offset, records and, to the last bit, the integers of its coordinates; other
    clouds become LAS 1.4, point format 7, at 0.1 mm. Whole numbers go into the standard dimension of their name where
    they fit it, colours of 8 bits as 16; all else becomes an extra dimension. Points without coordinates cannot be
    written.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from laspy import LasWriter  # noqa: PLC0415 - takes a fifth of a second

    finite = cloud.finite()
    if not finite.all():
        lost = np.count_nonzero(~finite)
        logger.warning("%s: %d points without coordinates are left out: LAS cannot hold them", path, lost)
        cloud = cloud.take(finite)
    world = cloud.world()
    header = old_header(cloud) if cloud.las_header else new_header(cloud, world)
    columns = columns_of_cloud(cloud, header)
    whole = np.rint((world - header.offsets) / header.scales)
    if len(whole) and (whole.max() > LARGEST_INTEGER or whole.min() < -LARGEST_INTEGER - 1):
        raise OutputError(f"{path}: the coordinates do not fit the scale of LAS. Name a .ply with -o.")
    compress = os.fspath(path).lower().endswith(".laz")
    if compress and header.point_format.id in LAYERED_WAVES:
        raise OutputError(
            f"{path}: wave packets (point format {header.point_format.id}) are not compressed. Name a .las."
        )
    with (
        open_output(path, binary=True) as stream,
        refusing_full_disk(path),
        LasWriter(stream, header, compress, closefd=False, encoding_errors="ignore") as writer,
    ):
        for start in range(0, len(cloud), CHUNK):
            rows = slice(start, start + CHUNK)
            some = {name: values[rows] for name, values in columns.items()}
            writer.write_points(packed_record(header, whole[rows], some))


@contextmanager
def refusing_full_disk(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn what the packer of LAZ says of a disk without room, no `OSError`, into one line."""
    try:
        yield
    except Exception as error:
        if type(error).__name__ != "LazrsError":
            raise
        raise OutputError(f"{path}: cannot be written ({error}).") from error


def packed_record(header: LasHeader, whole: NDArray[np.float64], columns: Mapping[str, Array]) -> PackedPointRecord:
    """Return points as they stand in the file."""
    from laspy.point.record import PackedPointRecord  # noqa: PLC0415

    record = PackedPointRecord.zeros(len(whole), header.point_format)
    for axis, name in enumerate("XYZ"):
        record.array[name] = whole[:, axis]
    for name, values in columns.items():
        if name in record.array.dtype.names:
            record.array[name] = values
        else:  # some bits of a byte
            record[name] = values
    return record


def old_header(cloud: PointCloud) -> LasHeader:
    """Return the header of the cloud's LAS file, with colours in its point format if the cloud has some.

    The dimensions of its own are still in its point format.
    """
    from laspy import LasHeader  # noqa: PLC0415
    from laspy.header import Version  # noqa: PLC0415
    from laspy.point import dims  # noqa: PLC0415
    from laspy.point.format import PointFormat  # noqa: PLC0415

    with refusing_damage(cloud.source):
        header = LasHeader.read_from(io.BytesIO(cloud.las_header))
        if header.number_of_evlrs and not any(record.user_id == COPC for record in header.vlrs):
            logger.warning("%s: records behind the points (EVLR) are left out", cloud.source)
        header.vlrs = [
            record for record in header.vlrs if type(record).__name__ not in REMADE and record.user_id != COPC
        ]
        own = list(header.point_format.extra_dimensions)
        kind = header.point_format.id
        if set(COLOURS) <= set(cloud.fields):
            kind = WITH_COLOURS.get(kind, kind)
        least = Version.from_str(dims.preferred_file_version_for_point_format(kind))
        version = max(header.version, least, key=lambda each: (each.major, each.minor))
        header.set_version_and_point_format(version, PointFormat(kind))
        header.point_format.dimensions += own
    header.start_of_waveform_data_packet_record = 0
    header.generating_software = "mapq"
    return header


def new_header(cloud: PointCloud, world: NDArray[np.float64]) -> LasHeader:
    """Return a header for a cloud that does not come from LAS."""
    from laspy import LasHeader  # noqa: PLC0415

    header = LasHeader(version="1.4", point_format=FRESH_FORMAT)
    header.global_encoding.wkt = True  # as point formats from 6 on have it
    header.offsets = cloud.shift.copy()
    reach = float(np.abs(world - cloud.shift).max(initial=0.0))
    scale = FINEST
    while reach / scale > LARGEST_INTEGER:
        scale *= 10.0
    header.scales = np.full(3, scale)
    header.generating_software = "mapq"
    return header


def columns_of_cloud(cloud: PointCloud, header: LasHeader) -> dict[str, Array]:
    """Return the values of each dimension but the coordinates, and declare the extra ones in the header."""
    from laspy.point.format import ExtraBytesParams, PointFormat  # noqa: PLC0415

    own = {item.name: item for item in header.point_format.extra_dimensions}
    header.point_format = PointFormat(header.point_format.id)
    standard = {item.name: item for item in header.point_format.standard_dimensions}
    columns: dict[str, Array] = {}
    extra = []
    for name, values in cloud.fields.items():
        fitting = _fitting(name, values, standard[name]) if name in standard else None
        if fitting is not None:
            columns[name] = fitting
        elif name in own and _is_of(values, own[name]):
            item = own[name]
            columns[name] = _raw(values, item)
            extra.append(ExtraBytesParams(name, item.dtype, item.description, item.offsets, item.scales, item.no_data))
        else:
            for part, column in scalar_columns(name, values):
                free = free_name(part, {*standard, *columns, *own, *RESERVED}, LONGEST_NAME)
                columns[free] = _storable(column)
                extra.append(ExtraBytesParams(free, columns[free].dtype))
    header.add_extra_dims(extra)
    return columns


def _fitting(name: str, values: Array, item: DimensionInfo) -> Array | None:
    """Return values that a standard dimension holds exactly, None if it does not."""
    if values.ndim != 1:
        return None
    if name in COLOURS and values.dtype == np.uint8:
        return values.astype(np.uint16) * np.uint16(TO_16_BITS)
    if item.dtype is not None and item.dtype.kind == "f":
        return values if values.dtype == item.dtype else None
    if values.dtype.kind not in "iub":
        return None
    fits = len(values) == 0 or (item.min <= int(values.min()) and int(values.max()) <= item.max)
    return values if fits else None


def _is_of(values: Array, item: DimensionInfo) -> bool:
    """Return whether values (n, ...) are as reading an extra dimension of a LAS file gives them, and can go back."""
    if item.is_scaled and not (np.isfinite(item.scales) & (item.scales != 0.0)).all():
        return False
    shape = (item.num_elements,) if item.num_elements > 1 else ()
    base = np.dtype(np.float64) if item.is_scaled else item.dtype.base
    return values.shape[1:] == shape and values.dtype == base


def _raw(values: Array, item: DimensionInfo) -> Array:
    """Return values as they stand in the file, of a scaled dimension the integers."""
    if not item.is_scaled:
        return values
    return np.asarray(np.rint((values - item.offsets) / item.scales).astype(item.dtype.base))


def _storable(values: Array) -> Array:
    """Return values (n,) in a type that extra dimensions have: truth values as 0 and 1, half precision as float32."""
    if values.dtype.kind == "b":
        return values.astype(np.uint8)
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        return values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    return values
