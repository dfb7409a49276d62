"""PCD: text, binary and compressed (LZF) are read, binary is written.

Header and layout are read here: pypcd4 takes a compressed field of COUNT > 1 for COUNT columns (PCL stores the field's
values point by point) and ends a header after ten lines.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content, damage_in_one_line
from mapq.io.fields import COLOURS, Array, axes_of, columns_of, make_cloud, original_names, refuse_doubles
from mapq.io.ply import vertex_rows
from mapq.io.text import as_count, parse_rows
from prf.shell.cli.files import open_output
from prf.shell.errors import InputError

LONGEST_HEADER = 1 << 16
PADDING = "_"
COMPRESSED = ("binary_compressed", "binaryscompressed")
"""The second spelling is that of an old program."""
PACKED = "rgb"
"""Field in which PCL and CloudCompare expect colours: red, green and blue in the bits of a float."""


class PcdHeader(NamedTuple):
    """Types of the fields, (count,) where there are several values, points, encoding, and where the data begin."""

    dtype: np.dtype[np.void]
    n_points: int
    data: str
    n_lines: int
    end: int


def read_pcd(content: Content, options: ReadOptions) -> PointCloud:
    """Return the cloud of a PCD file, without padding; a packed ``rgb`` keeps its bits, unless it repeats the colours.

    VIEWPOINT is not applied: it is where the sensor was, not a motion of the points. A folder of such files has its
    poses there (mapq.posed).
    """
    data, source = content.data(), content.source
    header = parse_header(data, source)
    kept = [name for name in header.dtype.names or () if not name.startswith(PADDING + " ")]
    axes_of(kept, source)
    if header.data == "ascii":
        fields = _read_ascii(data, header, source)
    elif header.data == "binary":
        fields = columns_of(np.frombuffer(data, header.dtype, header.n_points, header.end))
    else:
        fields = _read_compressed(data, header, source)
    columns = {name: fields[name] for name in kept}
    if {PACKED, *COLOURS} <= set(columns) and _bits(columns[PACKED]) == _bits(packed_colours(columns)):
        del columns[PACKED]
    return make_cloud(columns, source, options.unit or 1.0)


def _bits(values: Array) -> bytes:
    """Return the bits of numbers, so that nan equals itself."""
    return np.ascontiguousarray(values).tobytes()


def packed_colours(columns: Mapping[str, Array]) -> NDArray[np.float32]:
    """Return red, green and blue (n,) of 8 bits as PCL packs them (n,)."""
    red, green, blue = (columns[name].astype(np.uint32) for name in COLOURS)
    return (red << 16 | green << 8 | blue).astype("<u4").view("<f4")


def write_pcd(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a cloud as binary PCD, whole or not at all; ``-`` is standard output. OutputError if it cannot be written.

    Types and names are as in PLY (:func:`mapq.io.ply.write_ply`). Colours of 8 bits are packed into ``rgb`` besides,
    where viewers look for them; a field of this name that the cloud has gets the prefix `original_`.
    """
    if set(COLOURS) <= set(cloud.fields):
        fields = original_names(cloud.fields, (PACKED,))
        cloud = replace(cloud, fields={**fields, PACKED: packed_colours(fields)})
    rows = vertex_rows(cloud)
    types = [rows.dtype[name] for name in rows.dtype.names or ()]
    kinds = ["I" if kind.kind == "i" else kind.kind.upper() for kind in types]
    head = {
        "VERSION": ["0.7"],
        "FIELDS": rows.dtype.names or (),
        "SIZE": [str(kind.itemsize) for kind in types],
        "TYPE": kinds,
        "COUNT": ["1"] * len(types),
        "WIDTH": [str(len(rows))],
        "HEIGHT": ["1"],
        "VIEWPOINT": ["0 0 0 1 0 0 0"],
        "POINTS": [str(len(rows))],
        "DATA": ["binary"],
    }
    with open_output(path, binary=True) as stream:
        stream.write("".join(f"{key} {' '.join(words)}\n" for key, words in head.items()).encode())
        stream.write(rows.tobytes())


def read_viewpoint(content: Content) -> NDArray[np.float64]:
    """Return the pose (4, 4) of the sensor that a PCD file has as VIEWPOINT; that at the origin if it has none."""
    words = _entries(content.head, content.source)[0].get("VIEWPOINT") or ["0", "0", "0", "1", "0", "0", "0"]
    pose = np.eye(4)
    with damage_in_one_line(f"{content.source}: VIEWPOINT"):
        pose[:3, 3] = [float(word) for word in words[:3]]
        w, x, y, z = (float(word) for word in words[3:])
        pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    return pose


def parse_header(data: bytes, source: str) -> PcdHeader:
    """Return the header of a PCD file."""
    entries, n_lines, end = _entries(data, source)
    fields = entries.get("FIELDS") or entries.get("COLUMNS") or []
    types, sizes = entries.get("TYPE", []), entries.get("SIZE", [])
    counts = [_number(text, "COUNT", source) for text in entries.get("COUNT", ["1"] * len(fields))]
    if not fields or not len(fields) == len(types) == len(sizes) == len(counts):
        raise InputError(f"{source}: FIELDS, SIZE, TYPE and COUNT of the PCD header do not match. Write it anew.")
    dtype = []
    for place, (name, kind, size, count) in enumerate(zip(fields, types, sizes, counts, strict=True)):
        unique = f"{PADDING} {place}" if name == PADDING else name
        dtype.append((unique, f"<{kind.lower()}{size}", (count,) if count > 1 else ()))
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in ("ascii", "binary", *COMPRESSED):
        raise InputError(f"{source}: DATA {encoding[:24]!r} is not known; ascii, binary and binary_compressed are.")
    refuse_doubles([name for name, _, _ in dtype], source)
    return PcdHeader(np.dtype(dtype), _n_points(entries, source), encoding, n_lines, end)


def _entries(data: bytes, source: str) -> tuple[dict[str, list[str]], int, int]:
    """Return the header's entries, its number of lines, and where it ends."""
    entries: dict[str, list[str]] = {}
    start = n_lines = 0
    while "DATA" not in entries:
        end = data.find(b"\n", start, LONGEST_HEADER)
        if end < 0:
            raise InputError(f"{source}: the PCD header has no DATA line. Copy the file again.")
        words = data[start:end].decode("latin-1").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
        start, n_lines = end + 1, n_lines + 1
    return entries, n_lines, start


def _n_points(entries: dict[str, list[str]], source: str) -> int:
    """Return the number of points: POINTS, the only one that some programs set, or WIDTH x HEIGHT."""
    found = {key: _number(entries[key][0], key, source) for key in ("WIDTH", "HEIGHT", "POINTS") if entries.get(key)}
    points, grid = found.get("POINTS"), found["WIDTH"] * found.get("HEIGHT", 1) if "WIDTH" in found else None
    if points is None and grid is None:
        raise InputError(f"{source}: the PCD header has neither POINTS nor WIDTH. Write it anew.")
    if points is not None and grid and grid != points:
        raise InputError(f"{source}: POINTS is {points}, but WIDTH x HEIGHT is {grid}. Correct the header.")
    return points if points is not None else grid or 0


def _number(text: str, key: str, source: str) -> int:
    number = as_count(text)
    if number is None:
        raise InputError(f"{source}: {key} {text[:24]!r} of the PCD header must be a count. Correct the header.")
    return number


def _read_ascii(data: bytes, header: PcdHeader, source: str) -> dict[str, Array]:
    """Return the fields of text: its columns are those of the fields, one after the other."""
    parts = [(name, header.dtype[name].base, header.dtype[name].shape) for name in header.dtype.names or ()]
    columns = [(f"{name} {k}", kind) for name, kind, shape in parts for k in range(*(shape or (1,)))]
    rows = parse_rows(data[header.end :], np.dtype(columns), source, header.n_lines + 1)
    if len(rows) != header.n_points:
        raise InputError(f"{source}: the header promises {header.n_points} points, {len(rows)} follow. Copy it again.")
    return {
        name: np.stack([rows[f"{name} {k}"] for k in range(*shape)], axis=1) if shape else rows[f"{name} 0"]
        for name, _, shape in parts
    }


def _read_compressed(data: bytes, header: PcdHeader, source: str) -> dict[str, Array]:
    """Return the fields of compressed data: field after field, each point after point."""
    raw = _decompressed(data, header, source)
    fields, start = {}, 0
    for name in header.dtype.names or ():
        kind = header.dtype[name]
        fields[name] = np.frombuffer(raw, kind, header.n_points, start)
        start += fields[name].nbytes
    return fields


def _decompressed(data: bytes, header: PcdHeader, source: str) -> bytes:
    """Return the data without their compression; pypcd4 before 1.4 compressed them only where it paid."""
    import lzf  # noqa: PLC0415 - for compressed PCD alone

    packed_size, size = struct.unpack_from("<II", data, header.end)
    packed = data[header.end + 8 : header.end + 8 + packed_size]
    needed = header.n_points * header.dtype.itemsize
    raw = packed if size == packed_size == len(packed) else lzf.decompress(packed, min(size, needed))
    if raw is None or len(raw) != needed:
        raise InputError(f"{source}: the compressed data are damaged or cut off. Copy or download the file again.")
    return bytes(raw)
