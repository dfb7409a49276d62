"""PLY, the vertices: text or binary of both byte orders.

Only the element ``vertex`` is read. The header is read here, because files of the wild have comments in any encoding
and 64-bit integers, which plyfile refuses; where lists stand in the way, which only a walk over all rows can pass,
plyfile walks.
"""

from __future__ import annotations

import io
import re
import warnings
from typing import NamedTuple

import numpy as np
from plyfile import PlyData, PlyParseError  # type: ignore[import-untyped]

from mapq.io.fields import Array, axes_of, columns_of, refuse_doubles, warn_dropped
from mapq.io.rows import Layout, as_count, parse_rows
from prf.shell.errors import InputError

MAGIC = (b"ply\n", b"ply\r\n")
LONGEST_HEADER = 1 << 20
_END = re.compile(rb"^end_header\b", re.MULTILINE)
"""A comment may hold these words too."""

ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"},
}
"""Types of the format, both spellings; the 64-bit integers are not in it, but some programs write them."""


class Property(NamedTuple):
    """A property of an element; `length` is the type of a list's length, empty for a plain value."""

    name: str
    type: str
    length: str = ""


class Element(NamedTuple):
    """An element of the header."""

    name: str
    n_rows: int
    properties: list[Property]

    def dtype(self, order: str) -> np.dtype[np.void]:
        """Return the type of a row without lists."""
        return np.dtype([(item.name, order + TYPES[item.type]) for item in self.properties])

    @property
    def has_lists(self) -> bool:
        """Whether rows differ in length."""
        return any(item.length for item in self.properties)


class Header(NamedTuple):
    """What the header says: name of the format, elements, number of header lines, offset of the data."""

    format: str
    elements: list[Element]
    n_lines: int
    end: int


def read_ply(data: bytes, source: str) -> dict[str, Array]:
    """Return the properties of the vertices of a PLY file.

    Parameters
    ----------
    data : bytes
        The file.
    source : str
        Its name, for messages.

    Raises
    ------
    InputError
        For a header that cannot be read, a file without vertices, and data that are cut off.
    """
    header = parse_header(data, source)
    names = [element.name for element in header.elements]
    if "vertex" not in names:
        raise InputError(f"{source}: no element vertex; there are {', '.join(names) or 'none'}.")
    place = names.index("vertex")
    vertex, before = header.elements[place], header.elements[:place]
    axes_of([item.name for item in vertex.properties], source)
    _check_size(header, len(data), source)
    if vertex.has_lists or (header.format != "ascii" and any(element.has_lists for element in before)):
        return _walk(data, header, place, source)
    if header.format == "ascii":
        return columns_of(_read_ascii(data, header, before, vertex, source))
    order = ORDERS[header.format]
    start = header.end + sum(element.n_rows * element.dtype(order).itemsize for element in before)
    return columns_of(np.frombuffer(data, vertex.dtype(order), vertex.n_rows, start))


def parse_header(data: bytes, source: str) -> Header:
    """Return the header of a PLY file; comments are passed over."""
    found = _END.search(data, 0, LONGEST_HEADER)
    if found is None:
        raise InputError(f"{source}: the PLY header does not end. Copy the file again.")
    end = found.start()
    lines = data[:end].decode("latin-1").split("\n")
    format_name, elements = "", []
    for number, line in enumerate(lines, 1):
        where = f"{source}:{number}"
        match line.split():
            case ["format", name, *_] if name in ORDERS:
                format_name = name
            case ["element", name, count]:
                elements.append(Element(name, _count(count, where), []))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= set(TYPES):
                elements[-1].properties.append(Property(name, kind, length))
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1].properties.append(Property(name, kind))
            case [] | ["ply" | "comment" | "obj_info", *_]:
                pass
            case _:
                raise InputError(f"{where}: {line.strip()[:60]!r} is no line of a PLY header. Write the file anew.")
    if not format_name:
        raise InputError(f"{source}: the PLY header has no format line. Write the file anew.")
    for element in elements:
        refuse_doubles([item.name for item in element.properties], f"{source}: element {element.name}")
    newline = data.find(b"\n", end)
    return Header(format_name, elements, len(lines), len(data) if newline < 0 else newline + 1)


def _count(text: str, where: str) -> int:
    count = as_count(text)
    if count is None:
        raise InputError(f"{where}: {text[:24]!r} is not a count. Write the file anew.")
    return count


def _check_size(header: Header, size: int, source: str) -> None:
    """Refuse a header that promises more than the file can hold, before memory is taken for it."""
    needed = 0
    for element in header.elements:
        needed += element.n_rows * _least_bytes(element, header.format)
        if element.name == "vertex":
            break
    # The last row of a text may lack its line end.
    if needed > size - header.end + (header.format == "ascii"):
        raise InputError(
            f"{source}: cut off: the header promises at least {needed} bytes, {size - header.end} follow. "
            f"Copy or download the file again."
        )


def _least_bytes(element: Element, format_name: str) -> int:
    if format_name == "ascii":
        return max(1, 2 * len(element.properties))
    return sum(np.dtype(TYPES[item.length or item.type]).itemsize for item in element.properties)


def _read_ascii(data: bytes, header: Header, before: list[Element], vertex: Element, source: str) -> Array:
    start, n_before = header.end, sum(element.n_rows for element in before)
    for _ in range(n_before):
        start = data.find(b"\n", start) + 1 or len(data)
    body, line = data[start:], header.n_lines + 1 + n_before
    width = len(vertex.properties)
    layout = Layout(vertex.dtype("="), width, tuple(range(width)))
    rows = parse_rows(body, layout, source, line, vertex.n_rows) if vertex.n_rows else np.empty(0, layout.dtype)
    if len(rows) != vertex.n_rows:
        raise InputError(
            f"{source}: cut off: the header promises {vertex.n_rows} points, {len(rows)} follow. "
            f"Copy or download the file again."
        )
    return rows


def _walk(data: bytes, header: Header, place: int, source: str) -> dict[str, Array]:
    """Read past lists with plyfile: under a header that ends with the vertices, so that nothing behind them costs."""
    lines = ["ply", f"format {header.format} 1.0"]
    for element in header.elements[: place + 1]:
        lines.append(f"element {element.name} {element.n_rows}")
        for item in element.properties:
            lines.append(f"property {f'list {item.length} ' if item.length else ''}{item.type} {item.name}")
    try:
        head = "\n".join([*lines, "end_header", ""]).encode("ascii")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of numpy, that a list of a text is empty
            read = PlyData.read(io.BytesIO(head + data[header.end :]))
    except (PlyParseError, ValueError, TypeError, OverflowError, EOFError) as error:
        raise InputError(f"{source}: damaged or cut off ({' '.join(str(error).split())}). Copy it again.") from None
    rows = read.elements[place].data
    warn_dropped([item.name for item in header.elements[place].properties if item.length], source, "lists are not read")
    plain = [item.name for item in header.elements[place].properties if not item.length]
    return {name: rows[name] for name in plain}
