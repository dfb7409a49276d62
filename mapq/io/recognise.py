"""Which format a file of points has: from its content, and from its name only where the content cannot tell."""

from __future__ import annotations

import re
from typing import Literal

from mapq.io.npy import MAGIC as NPY_MAGIC
from mapq.io.npy import ZIP_MAGIC
from mapq.io.ply import MAGIC as PLY_MAGIC
from prf.shell.errors import InputError

Format = Literal["ply", "pcd", "npy", "npz", "kitti", "text"]

ACCEPTED = "Read are PLY, PCD, XYZ/TXT/CSV, .npy, .npz and KITTI .bin, also gzipped."

REFUSED = (
    (b"LASF", "a LAS or LAZ file"),
    (b"ASTM-E57", "an E57 file"),
    (b"# vtk DataFile", "a VTK file"),
    (b"#ROSBAG", "a ROS 1 bag"),
    (b"\x89MCAP", "a ROS 2 bag (MCAP)"),
    (b"SQLite format 3", "an SQLite file, perhaps a ROS 2 bag"),
    (b"\x89HDF", "an HDF5 file"),
    (b"OFF\n", "an OFF mesh"),
    (b"solid ", "an STL mesh"),
    (b"\x1f\x8b", "a file that was gzipped twice"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"%PDF", "a PDF document"),
    (b"\xff\xfe", "text in UTF-16; save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16; save it as UTF-8"),
    (b"{", "a JSON document"),
    (b"<", "an XML or HTML document"),
)
"""Contents that are known and not read."""

REFUSED_NAMES = {
    ".las": "a LAS file",
    ".laz": "a LAZ file",
    ".e57": "an E57 file",
    ".ptx": "a PTX file",
    ".vtk": "a VTK file",
    ".bag": "a ROS 1 bag",
    ".db3": "a ROS 2 bag",
    ".mcap": "a ROS 2 bag",
    ".3d": "a 3DTK file, in centimetres and left-handed",
    ".obj": "an OBJ mesh",
}
"""Ends of names of formats that are not read, for text without a magic number and for files that are damaged."""

HEADERS = {".ply": "PLY", ".pcd": "PCD", ".npy": "NPY", ".npz": "NPZ"}
"""Formats that need a header, by the end of the name."""

_PCD = re.compile(rb"\A(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t]*(?:VERSION[ \t]+\.?\d|(?:FIELDS|COLUMNS)[ \t])")
_PTX = re.compile(rb"\A\s*\d+\s*\n\s*\d+\s*\n(?:\s*\S+\s+\S+\s+\S+\s*\n){4}")


def recognise(data: bytes, name: str, source: str) -> Format:
    """Return the format of decompressed content.

    Parameters
    ----------
    data : bytes
        The content.
    name : str
        Name of the file, empty for standard input.
    source : str
        The name as messages have it.

    Raises
    ------
    InputError
        If no reader takes it; the line says what it looks like and what is read.
    """
    end = end_of(name)
    if not data.strip():
        raise InputError(f"{source}: the file is empty. {ACCEPTED}")
    known = _by_content(data)
    if known is not None:
        return known
    if end == ".bin":
        return "kitti"
    looks_like = _unreadable(data, end)
    if looks_like:
        raise InputError(f"{source}: {looks_like}. {ACCEPTED}")
    return "text"


def end_of(name: str) -> str:
    """Return the end of a file's name that tells its kind, such as ``.ply`` of ``A.PLY.gz``; empty without a point."""
    _, point, end = re.sub(r"\.gz$", "", name.lower()).rpartition(".")
    return point + end if point else ""


def _by_content(data: bytes) -> Format | None:
    if data.startswith(PLY_MAGIC):
        return "ply"
    if data.startswith(NPY_MAGIC):
        return "npy"
    if data.startswith(ZIP_MAGIC):
        return "npz"
    return "pcd" if _PCD.match(data[:4096]) else None


def _unreadable(data: bytes, end: str) -> str | None:
    """Return what content that no magic number names looks like, None for text that may be points."""
    for magic, name in REFUSED:
        if data.startswith(magic):
            return f"this is {name}"
    if end in REFUSED_NAMES:
        return f"this is {REFUSED_NAMES[end]}"
    if end in HEADERS:
        return f"no {HEADERS[end]} header: the file is damaged, or its name is wrong"
    if b"\0" in data[:4096]:
        return "this is binary data of an unknown kind"
    return "this is a PTX file" if _PTX.match(data[:1024]) else None
