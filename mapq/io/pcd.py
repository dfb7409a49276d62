"""PCD: text, binary and compressed.

Header and layout are read here and only the decompression is a library's: pypcd4 takes a compressed field of COUNT > 1
for COUNT columns (PCL stores the field's values point by point), cuts a header after ten lines and a name at the first
sign that is not a letter, and takes one blank, no more, between the numbers of a text.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import lzf  # type: ignore[import-not-found]
import numpy as np

from mapq.io.fields import Array, axes_of, columns_of, refuse_doubles
from mapq.io.rows import Layout, as_count, parse_rows
from prf.shell.errors import InputError

LONGEST_HEADER = 1 << 16
PADDING = "_"
TYPES = {
    **{("F", 4): "f4", ("F", 8): "f8", ("I", 1): "i1", ("I", 2): "i2", ("I", 4): "i4", ("I", 8): "i8"},
    **{("U", 1): "u1", ("U", 2): "u2", ("U", 4): "u4", ("U", 8): "u8"},
}
COMPRESSED = ("binary_compressed", "binaryscompressed")
"""The second spelling is that of an old program."""

LZF_RATIO = 90
"""LZF makes at most 264 bytes of 3; a file that promises more is damaged."""


class Header(NamedTuple):
    """What the header says: a field's values a point are (count,) of its type."""

    dtype: np.dtype[np.void]
    n_points: int
    data: str
    n_lines: int
    end: int


def read_pcd(data: bytes, source: str) -> dict[str, Array]:
    """Return the fields of a PCD file, without padding.

    Parameters
    ----------
    data : bytes
        The file.
    source : str
        Its name, for messages.

    Returns
    -------
    dict of str to (n,) or (n, count) array
        A packed ``rgb`` keeps its bits. VIEWPOINT is not applied: it says where the sensor stood, not how to move
        the points.

    Raises
    ------
    InputError
        For a header that cannot be read or contradicts itself, and data that are cut off or damaged.
    """
    header = parse_header(data, source)
    names = list(header.dtype.names or ())
    kept = [name for name in names if not name.startswith(PADDING + " ")]
    axes_of(kept, source)
    if header.data == "ascii":
        fields = _read_ascii(data, header, source)
    elif header.data == "binary":
        _check_size(header, len(data) - header.end, source)
        fields = columns_of(np.frombuffer(data, header.dtype, header.n_points, header.end))
    else:
        fields = _read_compressed(data, header, source)
    return {name: fields[name] for name in kept}


def parse_header(data: bytes, source: str) -> Header:
    """Return the header of a PCD file; raises :class:`InputError` naming the entry that is missing or wrong."""
    entries, n_lines, end = _entries(data, source)
    fields = entries.get("FIELDS") or entries.get("COLUMNS") or []
    types = entries.get("TYPE", [])
    sizes = [_number(text, "SIZE", source) for text in entries.get("SIZE", [])]
    counts = [_number(text, "COUNT", source) for text in entries.get("COUNT", ["1"] * len(fields))]
    if not fields or not len(fields) == len(types) == len(sizes) == len(counts):
        raise InputError(f"{source}: FIELDS, SIZE, TYPE and COUNT of the PCD header do not match. Write it anew.")
    dtype = []
    for place, (name, kind, size, count) in enumerate(zip(fields, types, sizes, counts, strict=True)):
        if (kind, size) not in TYPES or not 0 < count <= 1 << 16:
            raise InputError(f"{source}: field {name} of type {kind}, size {size}, count {count} is not PCD.")
        unique = f"{PADDING} {place}" if name == PADDING else name
        dtype.append((unique, "<" + TYPES[kind, size], (count,) if count > 1 else ()))
    refuse_doubles([name for name, _, _ in dtype], source)
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in ("ascii", "binary", *COMPRESSED):
        raise InputError(f"{source}: DATA {encoding[:24]!r} is not known; ascii, binary and binary_compressed are.")
    return Header(np.dtype(dtype), _n_points(entries, source), encoding, n_lines, end)


def _entries(data: bytes, source: str) -> tuple[dict[str, list[str]], int, int]:
    """Return the header's entries, how many lines it has, and where it ends."""
    entries: dict[str, list[str]] = {}
    start = n_lines = 0
    while "DATA" not in entries:
        end = data.find(b"\n", start, start + LONGEST_HEADER)
        if end < 0 or start > LONGEST_HEADER:
            raise InputError(f"{source}: the PCD header has no DATA line. Copy the file again.")
        words = data[start:end].decode("latin-1").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
        start, n_lines = end + 1, n_lines + 1
    return entries, n_lines, start


def _n_points(entries: dict[str, list[str]], source: str) -> int:
    """Return the number of points: POINTS, which some programs fill in alone, or WIDTH x HEIGHT."""
    width, height, points = (
        _number(entries[key][0], key, source) if entries.get(key) else None for key in ("WIDTH", "HEIGHT", "POINTS")
    )
    grid = None if width is None else width * (1 if height is None else height)
    if points is None and grid is None:
        raise InputError(f"{source}: the PCD header has neither POINTS nor WIDTH. Write it anew.")
    if points is not None and grid and grid != points:
        raise InputError(f"{source}: POINTS is {points}, but WIDTH x HEIGHT is {grid}. Mend the header.")
    return points if points is not None else grid or 0


def _number(text: str, key: str, source: str) -> int:
    number = as_count(text)
    if number is None:
        raise InputError(f"{source}: {key} {text[:24]!r} of the PCD header is not a count. Mend the header.")
    return number


def _check_size(header: Header, size: int, source: str) -> None:
    """Refuse a header that promises more than follows, before memory is taken for it."""
    needed = header.n_points * header.dtype.itemsize
    if needed > size:
        raise InputError(
            f"{source}: cut off: {header.n_points} points of {header.dtype.itemsize} bytes are promised, {size} bytes "
            f"follow. Copy or download the file again."
        )


def _read_ascii(data: bytes, header: Header, source: str) -> dict[str, Array]:
    names = header.dtype.names or ()
    columns = [(name, number) for name in names for number in range(max(1, _count(header.dtype, name)))]
    dtype = np.dtype([(f"{name} {number}", header.dtype[name].base) for name, number in columns])
    layout = Layout(dtype, len(columns), tuple(range(len(columns))))
    rows = parse_rows(data[header.end :], layout, source, header.n_lines + 1)
    if len(rows) != header.n_points:
        raise InputError(
            f"{source}: the header promises {header.n_points} points, {len(rows)} follow. Copy the file again, or "
            f"mend WIDTH and POINTS."
        )
    return {
        name: np.stack([rows[f"{name} {number}"] for number in range(count)], axis=1) if count else rows[f"{name} 0"]
        for name in names
        for count in (_count(header.dtype, name),)
    }


def _count(dtype: np.dtype[np.void], name: str) -> int:
    """Return the values a point of a field, 0 for a plain one."""
    return int(dtype[name].shape[0]) if dtype[name].shape else 0


def _read_compressed(data: bytes, header: Header, source: str) -> dict[str, Array]:
    """Return the fields of compressed data: field after field, each point after point."""
    raw = _decompress(data, header, source)
    fields, start = {}, 0
    for name in header.dtype.names or ():
        kind, count = header.dtype[name].base, _count(header.dtype, name)
        values = np.frombuffer(raw, kind, header.n_points * max(1, count), start)
        fields[name] = values.reshape(-1, count) if count else values
        start += values.nbytes
    return fields


def _decompress(data: bytes, header: Header, source: str) -> bytes:
    needed = header.n_points * header.dtype.itemsize
    if needed == 0:
        return b""
    sizes = data[header.end : header.end + 8]
    if len(sizes) < 8:
        raise InputError(f"{source}: cut off behind the header. Copy or download the file again.")
    packed_size, size = struct.unpack("<II", sizes)
    packed = data[header.end + 8 : header.end + 8 + packed_size]
    if len(packed) < packed_size:
        raise InputError(
            f"{source}: cut off: {packed_size} compressed bytes are promised, {len(packed)} follow. "
            f"Copy or download the file again."
        )
    if size == needed == packed_size:
        return packed  # pypcd4 before 1.4 did not compress where it did not pay
    if size != needed or size > LZF_RATIO * packed_size:
        raise InputError(
            f"{source}: damaged: {header.n_points} points of {header.dtype.itemsize} bytes are promised, the "
            f"compressed data hold {size} bytes. Copy or download it again."
        )
    try:
        raw: bytes | None = lzf.decompress(packed, size)
    except ValueError:
        raw = None
    if raw is None or len(raw) != size:
        raise InputError(f"{source}: the compressed data are damaged. Copy or download the file again.")
    return raw
