"""PLY: the vertices of a file, text or binary of both byte orders; and a cloud as CloudCompare and MeshLab open it.

Read and written here: plyfile refuses comments that are not ASCII and 64-bit integers, and reads text row by row.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import Array, axes_of, columns_of, free_name, make_cloud, refuse_doubles, scalar_columns
from mapq.io.text import LARGEST_EXACT, parse_rows
from prf.shell.cli.files import open_output
from prf.shell.errors import InputError, OutputError

logger = logging.getLogger(__name__)

MAGIC = (b"ply\n", b"ply\r\n")
LONGEST_HEADER = 1 << 20
_END = re.compile(rb"^end_header\b.*\n?", re.MULTILINE)

ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
WRITTEN = {
    **{"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"},
    **{"f4": "float", "f8": "double"},
}
"""Names of the types that are written."""
TYPES = {
    **{name: code for code, name in WRITTEN.items()},
    **{np.dtype(code).name: code for code in (*WRITTEN, "i8", "u8")},
}
"""Types of the format, both spellings; the 64-bit integers are not in it, but PDAL writes them."""


class Element(NamedTuple):
    """An element of the header: names and types of its plain properties, and names of its lists."""

    name: str
    n_rows: int
    properties: list[tuple[str, str]]
    lists: list[str]

    def dtype(self, order: str) -> np.dtype[np.void]:
        """Return the type of a row without lists."""
        return np.dtype([(name, order + kind) for name, kind in self.properties])


def read_ply(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of the vertices of a PLY file; what follows these is passed over."""
    data, source = content.data(), content.source
    format_name, elements, n_lines, start = _parse_header(data, source)
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise InputError(f"{source}: no element vertex; there are {', '.join(names) or 'none'}.")
    before, vertex = elements[: names.index("vertex")], elements[names.index("vertex")]
    names = [name for name, _ in vertex.properties]
    axes_of(names, source)
    refuse_doubles(names, source)
    is_text, order = format_name == "ascii", ORDERS[format_name]
    if vertex.lists or (not is_text and any(element.lists for element in before)):
        raise InputError(f"{source}: lists in or before the vertices are not read. Save the cloud without them.")
    if is_text:
        n_before = sum(element.n_rows for element in before)
        for _ in range(n_before):
            start = data.find(b"\n", start) + 1 or len(data)
        rows = _read_ascii(data[start:], vertex, source, n_lines + 1 + n_before)
    else:
        start += sum(element.n_rows * element.dtype(order).itemsize for element in before)
        rows = np.frombuffer(data, vertex.dtype(order), vertex.n_rows, start)
    return make_cloud(columns_of(rows), source, options.unit or 1.0)


def _parse_header(data: bytes, source: str) -> tuple[str, list[Element], int, int]:
    """Return the name of the format, the elements, the number of header lines, and where the data begin.

    Comments are skipped, whatever their encoding.
    """
    found = _END.search(data, 0, LONGEST_HEADER)
    if found is None:
        raise InputError(f"{source}: the PLY header does not end. Copy the file again.")
    lines = data[: found.start()].decode("latin-1").split("\n")
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
                raise InputError(
                    f"{source}:{number}: {line.strip()[:60]!r} does not belong into a PLY header. Export it again."
                )
    if not format_name:
        raise InputError(f"{source}: the PLY header has no format line. Write the file anew.")
    return format_name, elements, len(lines), found.end()


def _read_ascii(body: bytes, vertex: Element, source: str, line: int) -> Array:
    rows = np.empty(0, vertex.dtype("="))
    if vertex.n_rows:
        rows = parse_rows(body, rows.dtype, source, line, max_rows=vertex.n_rows)
    if len(rows) != vertex.n_rows:
        raise InputError(f"{source}: cut off: {vertex.n_rows} points are promised, {len(rows)} follow. Copy it again.")
    return rows


def write_ply(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud as binary little endian PLY, whole or not at all; ``-`` is standard output.

    Coordinates are written as the file had them, without the shift: float if they were float32 and there is no
    shift, else double. All fields keep name and type, except for what PLY has no form for:

    * a field (n, k) becomes k properties `name_0` to `name_k-1`;
    * bool becomes uchar, float16 float; a 64-bit integer becomes int or uint if its values fit, else double, with a
      warning if values beyond 2^53 lose digits;
    * characters that a property name may not have become ``_``, and a name that is taken gets `_2`.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    rows = vertex_rows(cloud)
    with open_output(path, binary=True) as stream:
        stream.write(header_of(rows.dtype, len(rows)))
        stream.write(rows.tobytes())


def write_ply_pieces(path: str, n_points: int, pieces: Iterable[PointCloud]) -> None:
    """Write a cloud of this many points piece by piece, of which the first has the properties of all.

    Raises OutputError if it cannot be written, or a piece has other fields.
    """
    with open_output(path, binary=True) as stream:
        record = None
        for cloud in pieces:
            rows = vertex_rows(replace(cloud, coordinate_type=np.float64))
            if record is None:
                record = rows.dtype
                stream.write(header_of(record, n_points))
            if rows.dtype != record:
                raise OutputError(f"{path}: {cloud.source} has other fields than the files before. Name a folder.")
            stream.write(rows.tobytes())


def header_of(dtype: np.dtype[Any], n_rows: int) -> bytes:
    """Return the header of a binary file of this many vertices of this type."""
    properties = [f"property {WRITTEN[dtype[name].str[1:]]} {name}" for name in dtype.names or ()]
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {n_rows}", *properties, "end_header", ""]
    return "\n".join(lines).encode()


def vertex_rows(cloud: PointCloud) -> Array:
    """Return the structured array (n,) of the vertices, little endian."""
    small = cloud.coordinate_type is np.float32 and not cloud.shift.any()
    world = cloud.world().astype(np.float32 if small else np.float64)
    columns: dict[str, Array] = {name: world[:, axis] for axis, name in enumerate("xyz")}
    for name, values in cloud.fields.items():
        for part, column in scalar_columns(name, values):
            columns[free_name(part, columns)] = _storable(name, column)
    rows = np.empty(len(cloud), [(name, column.dtype.newbyteorder("<")) for name, column in columns.items()])
    for name, column in columns.items():
        rows[name] = column
    return rows


def _storable(name: str, values: Array) -> Array:
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
