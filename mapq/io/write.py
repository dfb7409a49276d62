"""Writing a cloud in the format of its name: PLY, PCD, text, or LAS and LAZ under the header of its source in LAS."""

from __future__ import annotations

import io
import logging
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.content import damage_in_one_line, suffix_of
from mapq.io.fields import COLOURS, Array, free_name, scalar_columns
from mapq.io.pcd import write_pcd
from mapq.io.ply import write_ply
from mapq.io.text import TEXT_SUFFIXES, write_text
from prf.shell.cli.files import open_output
from prf.shell.cli.outputs import FORMATS, refuse_other_format
from prf.shell.errors import OutputError, UsageError

if TYPE_CHECKING:
    from laspy import LasHeader, LasWriter
    from laspy.point.dims import DimensionInfo

logger = logging.getLogger(__name__)

LAS_SUFFIXES = (".las", ".laz")
WRITERS: Mapping[str, Callable[[str | os.PathLike[str], PointCloud], None]] = {
    ".ply": write_ply,
    ".pcd": write_pcd,
    **dict.fromkeys(TEXT_SUFFIXES, write_text),
}
"""Writers of the other formats, by suffix; a name of none is that of a PLY."""

FRESH_FORMAT = 7
"""Point format of clouds that are not from LAS: that of LAS 1.4 with time and colours."""
WITH_COLOURS = {0: 2, 1: 3, 4: 5, 6: 7, 9: 10}
"""Point format that also has colours, of one that has none."""
TO_16_BITS = 257
"""Takes 0 to 255 to 0 to 65,535."""

FINEST = 1e-4
"""Metres: the scale of clouds that are not from LAS, if they are not too large for it."""
LARGEST_INTEGER = 2**31 - 1

LONGEST_NAME = 32
"""Bytes of the name of an extra dimension."""

REMADE = ("LasZipVlr", "ExtraBytesVlr")
"""Records that laspy makes anew."""
COPC = "copc"
"""User of the records that index the points of COPC: they do not hold for points in another file."""
RESERVED = ("x", "y", "z", "X", "Y", "Z")


def write_cloud(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud in the format that the suffix of the name states, as PLY without one; ``-`` is standard output.

    Raises
    ------
    OutputError
        If it cannot be written.
    UsageError
        As :func:`check_name`.
    """
    check_name(path)
    suffix = suffix_of(os.fspath(path))
    if suffix not in LAS_SUFFIXES:
        WRITERS.get(suffix, write_ply)(path, cloud)
        return
    with open_las_pieces(path) as pieces:
        pieces.write(cloud)


def written_suffix(path: str) -> str:
    """Return the suffix of a copy of the cloud `path` that keeps its format, ``.ply`` where that is not written."""
    suffix = suffix_of(path)
    if suffix in WRITERS or suffix in LAS_SUFFIXES:
        return suffix
    if suffix in FORMATS:
        logger.info("%s: %s is read, not written; the default output is a PLY", path, suffix[1:].upper())
    return ".ply"


def check_name(path: str | os.PathLike[str]) -> None:
    """Raise UsageError for a format that is not written, before the work begins."""
    if os.fspath(path).lower().endswith(".copc.laz"):
        raise UsageError(f"{path}: COPC is not written, only plain LAZ. Name a .laz without .copc.")
    refuse_other_format(path, (*WRITERS, *LAS_SUFFIXES))


@contextmanager
def open_las_pieces(path: str | os.PathLike[str]) -> Iterator[LasPieces]:
    """Give a LAS file, LAZ if the name ends so, to be written piece by piece, whole or not at all."""
    with open_output(path, binary=True) as stream:
        pieces = LasPieces(os.fspath(path), stream)
        try:
            yield pieces
            pieces.close()
        except Exception as error:
            if type(error).__name__ != "LazrsError":  # of a full disk: no OSError
                raise
            raise OutputError(f"{path}: cannot be written ({error}).") from error


class LasPieces:
    """A LAS file that is being written, under the header of the first piece; see :func:`open_las_pieces`.

    A cloud from LAS keeps version, scale, offset, records and, to the last bit, the integers of its coordinates; other
    clouds become LAS 1.4, point format 7, at 0.1 mm. Whole numbers are written to the standard dimension of their name
    where they fit it, colours of 8 bits as 16; all else becomes an extra dimension. Points without coordinates cannot
    be written.
    """

    def __init__(self, path: str, stream: IO[Any]) -> None:
        self._path, self._stream = path, stream
        self._writer: LasWriter | None = None
        self._head = b""
        self._types: dict[str, np.dtype[Any]] = {}

    def write(self, cloud: PointCloud) -> None:
        """Append points; OutputError if their fields or coordinates do not fit those of the first piece."""
        from laspy import LasWriter  # noqa: PLC0415 - for LAS alone
        from laspy.point.record import PackedPointRecord  # noqa: PLC0415

        finite = cloud.finite()
        if not finite.all():
            n_lost = np.count_nonzero(~finite)
            logger.warning("%s: %d points without coordinates are left out: LAS cannot hold them", self._path, n_lost)
            cloud = cloud.take(finite)
        world = cloud.world()
        self._head = self._head or cloud.las_header
        header = _old_header(cloud, self._head) if self._head else _new_header(cloud, world)
        columns = _columns(cloud, header)
        types = {name: values.dtype for name, values in columns.items()}
        if self._writer is None:
            compress = self._path.lower().endswith(".laz")
            self._writer = LasWriter(self._stream, header, compress, closefd=False, encoding_errors="ignore")
            self._types = types
        if types != self._types:
            raise OutputError(f"{self._path}: {cloud.source} has other fields than the files before. Name a folder.")
        header = self._writer.header
        whole = np.rint((world - header.offsets) / header.scales)
        if len(whole) and (whole.max() > LARGEST_INTEGER or whole.min() < -LARGEST_INTEGER - 1):
            raise OutputError(f"{self._path}: the coordinates do not fit the scale of LAS. Name a .ply with -o.")
        record = PackedPointRecord.zeros(len(world), header.point_format)
        columns |= dict(zip("XYZ", whole.T, strict=True))
        for name, values in columns.items():  # some dimensions are bits of a byte
            (record.array if name in record.array.dtype.names else record)[name] = values
        self._writer.write_points(record)

    def close(self) -> None:
        """Write what belongs behind the points."""
        if self._writer is not None:
            self._writer.close()


def _old_header(cloud: PointCloud, stored: bytes) -> LasHeader:
    """Return the header of a LAS file, with its own dimensions, and with colours if the cloud has some."""
    from laspy import LasHeader  # noqa: PLC0415
    from laspy.header import Version  # noqa: PLC0415
    from laspy.point import dims  # noqa: PLC0415
    from laspy.point.format import PointFormat  # noqa: PLC0415

    with damage_in_one_line(cloud.source):
        header = LasHeader.read_from(io.BytesIO(stored))
    if header.number_of_evlrs and not any(record.user_id == COPC for record in header.vlrs):
        logger.warning("%s: records behind the points (EVLR) are left out", cloud.source)
    header.vlrs = [each for each in header.vlrs if type(each).__name__ not in REMADE and each.user_id != COPC]
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


def _new_header(cloud: PointCloud, world: NDArray[np.float64]) -> LasHeader:
    """Return a header for a cloud that does not come from LAS."""
    from laspy import LasHeader  # noqa: PLC0415

    header = LasHeader(version="1.4", point_format=FRESH_FORMAT)
    header.global_encoding.wkt = True  # as point formats from 6 on have it
    header.offsets = cloud.shift.copy()
    farthest, scale = float(np.abs(world - cloud.shift).max(initial=0.0)), FINEST
    while farthest / scale > LARGEST_INTEGER:
        scale *= 10.0
    header.scales = np.full(3, scale)
    header.generating_software = "mapq"
    return header


def _columns(cloud: PointCloud, header: LasHeader) -> dict[str, Array]:
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
    is_whole = values.dtype.kind in "iub"
    fits = is_whole and (len(values) == 0 or (item.min <= int(values.min()) and int(values.max()) <= item.max))
    return values if fits else None


def _is_of(values: Array, item: DimensionInfo) -> bool:
    """Return whether values (n, ...) are as an extra dimension of a LAS file is read, and can be written back."""
    shape = (item.num_elements,) if item.num_elements > 1 else ()
    base = np.dtype(np.float64) if item.is_scaled else item.dtype.base
    return values.shape[1:] == shape and values.dtype == base


def _raw(values: Array, item: DimensionInfo) -> Array:
    """Return values as they are in the file, of a scaled dimension the integers."""
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
