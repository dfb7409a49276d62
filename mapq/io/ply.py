"""PLY: the vertices of a file, text or binary of both byte orders; and a cloud as CloudCompare and MeshLab open it.

The header is read here, because plyfile refuses comments that are not ASCII and 64-bit integers, and reads text and
streams row by row; plyfile reads files with lists before or in the vertices.
"""

from __future__ import annotations

import io
import logging
import os
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from plyfile import PlyData, PlyElement  # type: ignore[import-untyped]

from mapq.cloud import PointCloud
from mapq.io.fields import Array, axes_of, columns_of, free_name, refuse_doubles, scalar_columns, warn_dropped
from mapq.io.rows import Layout, parse_rows
from prf.shell.errors import InputError
from prf.shell.files import open_output

logger = logging.getLogger(__name__)

MAGIC = (b"ply\n", b"ply\r\n")
LONGEST_HEADER = 1 << 20
_END = re.compile(rb"^end_header\b", re.MULTILINE)

ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"},
}
"""Types of the format, both spellings; the 64-bit integers are not in it, but PDAL writes them."""

LARGEST_EXACT = 2**53
"""Whole numbers up to here are exact in double precision."""


class Element(NamedTuple):
    """An element of the header: names and types of its plain properties, and names of its lists."""

    name: str
    n_rows: int
    properties: list[tuple[str, str]]
    lists: list[str]

    def dtype(self, order: str) -> np.dtype[np.void]:
        """Return the type of a row without lists."""
        return np.dtype([(name, order + kind) for name, kind in self.properties])


class Header(NamedTuple):
    """Name of the format, elements, number of header lines, offset of the data."""

    format: str
    elements: list[Element]
    n_lines: int
    end: int


def read_ply(data: bytes, source: str) -> dict[str, Array]:
    """Return the properties of the vertices of a PLY file; lists are dropped with a warning."""
    header = parse_header(data, source)
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        raise InputError(f"{source}: no element vertex; there are {', '.join(names) or 'none'}.")
    place = names.index("vertex")
    vertex, before = header.elements[place], header.elements[:place]
    axes_of([name for name, _ in vertex.properties], source)
    if vertex.lists or (header.format != "ascii" and any(element.lists for element in before)):
        warn_dropped(vertex.lists, source, "lists are not read")
        rows = PlyData.read(io.BytesIO(data))["vertex"].data
        return {name: rows[name] for name, _ in vertex.properties}
    if header.format == "ascii":
        return columns_of(_read_ascii(data, header, before, vertex, source))
    order = ORDERS[header.format]
    start = header.end + sum(element.n_rows * element.dtype(order).itemsize for element in before)
    return columns_of(np.frombuffer(data, vertex.dtype(order), vertex.n_rows, start))


def parse_header(data: bytes, source: str) -> Header:
    """Return the header of a PLY file; comments are skipped, whatever their encoding."""
    found = _END.search(data, 0, LONGEST_HEADER)
    if found is None:
        raise InputError(f"{source}: the PLY header does not end. Copy the file again.")
    end = found.start()
    lines = data[:end].decode("latin-1").split("\n")
    format_name, elements = "", []
    for number, line in enumerate(lines, 1):
        match line.split():
            case ["format", name, *_] if name in ORDERS:
                format_name = name
            case ["element", name, count] if count.isdecimal():
                elements.append(Element(name, int(count), [], []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= set(TYPES):
                elements[-1].lists.append(name)
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append((name, TYPES[kind]))
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise InputError(f"{source}:{number}: {line.strip()[:60]!r} is no line of a PLY header. Write it anew.")
    if not format_name:
        raise InputError(f"{source}: the PLY header has no format line. Write the file anew.")
    for element in elements:
        refuse_doubles([name for name, _ in element.properties] + element.lists, f"{source}: element {element.name}")
    newline = data.find(b"\n", end)
    return Header(format_name, elements, len(lines), len(data) if newline < 0 else newline + 1)


def _read_ascii(data: bytes, header: Header, before: list[Element], vertex: Element, source: str) -> Array:
    start, n_before = header.end, sum(element.n_rows for element in before)
    for _ in range(n_before):
        start = data.find(b"\n", start) + 1 or len(data)
    layout, line = Layout.of(vertex.dtype("=")), header.n_lines + 1 + n_before
    rows = parse_rows(data[start:], layout, source, line, vertex.n_rows) if vertex.n_rows else np.empty(0, layout.dtype)
    if len(rows) != vertex.n_rows:
        raise InputError(f"{source}: cut off: {vertex.n_rows} points are promised, {len(rows)} follow. Copy it again.")
    return rows


def write_ply(path: str | os.PathLike[str], cloud: PointCloud, extra: Mapping[str, Array] | None = None) -> None:
    """Write a cloud as binary little endian PLY, whole or not at all.

    Coordinates are written as the file had them, without the shift: float if they were float32 and there is no
    shift, else double. All fields keep name and type, except for what PLY has no form for:

    * a field (n, k) becomes k properties `name_0` to `name_k-1`;
    * bool becomes uchar, float16 float; a 64-bit integer becomes int or uint if its values fit, else double, with a
      warning if values beyond 2^53 lose digits;
    * characters that a property name may not have become ``_``, and a name that is taken gets `_2`.

    Parameters
    ----------
    path : path
        ``-`` is standard output.
    cloud : PointCloud
    extra : mapping of str to (n, ...) array, optional
        Further fields, behind the cloud's own; one of the same name replaces it.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    rows = vertex_rows(cloud, {**cloud.fields, **(extra or {})})
    element = PlyElement.describe(rows, "vertex")
    with open_output(path, binary=True) as stream:
        PlyData([element], byte_order="<").write(stream)


def vertex_rows(cloud: PointCloud, fields: Mapping[str, Array]) -> Array:
    """Return the structured array (n,) of the vertices."""
    small = cloud.coordinate_type is np.float32 and not cloud.shift.any()
    world = cloud.world().astype(np.float32 if small else np.float64)
    columns: dict[str, Array] = {name: world[:, axis] for axis, name in enumerate("xyz")}
    for name, values in fields.items():
        for part, column in scalar_columns(name, values):
            columns[free_name(part, columns)] = storable(name, column)
    rows = np.empty(len(cloud), [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    return rows


def storable(name: str, values: Array) -> Array:
    """Return values (n,) in a type that PLY has; see :func:`write_ply`."""
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind == "b":
        return values.astype(np.uint8)
    if kind == "f":
        return values if size in (4, 8) else values.astype(np.float32 if size < 4 else np.float64)
    if size < 8:
        return values
    low, high = (int(values.min()), int(values.max())) if len(values) else (0, 0)
    for narrow in (np.int32, np.uint32):
        if np.iinfo(narrow).min <= low and high <= np.iinfo(narrow).max:
            return values.astype(narrow)
    if max(-low, high) > LARGEST_EXACT:
        logger.warning("field %s is rounded: PLY has no 64-bit integers, and double holds them exactly to 2^53", name)
    return values.astype(np.float64)
