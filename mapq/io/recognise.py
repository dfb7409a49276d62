"""Which format a file of points has: from its content, and from its name only where the content cannot tell."""

from __future__ import annotations

import re

from mapq.io.content import ACCEPTED, Content
from mapq.io.formats import MAGICS, Format
from prf.shell.bag import bag_suffix
from prf.shell.errors import InputError

REFUSED = (
    (b"#ROSBAG", "a ROS 1 bag of an old version, which rosbag fix can convert"),
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

REFUSED_NAMES = {".obj": "an OBJ mesh"}
"""Suffixes of formats that are not read, for text without a magic number."""

HEADERS = {
    **{".ply": "PLY", ".pcd": "PCD", ".npy": "NPY", ".npz": "NPZ", ".las": "LAS", ".laz": "LAS", ".e57": "E57"},
    **{".ptx": "PTX", ".vtk": "VTK", ".bag": "ROS bag", ".db3": "SQLite", ".mcap": "MCAP"},
}
"""Formats that need a header, by their suffix."""

_PCD = re.compile(rb"\A(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t]*(?:VERSION[ \t]+\.?\d|(?:FIELDS|COLUMNS)[ \t])")
_PTX = re.compile(rb"\A\s*\d+\s*\n\s*\d+\s*\n(?:[ \t]*\S+[ \t]+\S+[ \t]+\S+\s*\n){4}")


def recognise(content: Content) -> Format:
    """Return the format of an input.

    Raises
    ------
    InputError
        If no reader takes it; the line says what it looks like and what is read.
    """
    if content.is_folder:
        return "bag"
    head, suffix = content.head, suffix_of(content.name)
    if not head.strip():
        raise InputError(f"{content.source}: the file is empty. {ACCEPTED}")
    known = _by_content(head)
    if known is not None:
        return known
    if suffix == ".bin":
        return "kitti"
    looks_like = _unreadable(head, suffix)
    if looks_like:
        raise InputError(f"{content.source}: {looks_like}. {ACCEPTED}")
    return "3d" if suffix == ".3d" else "text"


def suffix_of(name: str) -> str:
    """Return the suffix that tells a file's kind, such as ``.ply`` of ``A.PLY.gz``; empty without a point."""
    _, point, suffix = re.sub(r"\.gz$", "", name.lower()).rpartition(".")
    return point + suffix if point else ""


def _by_content(head: bytes) -> Format | None:
    for magic, kind in MAGICS:
        if head.startswith(magic):
            return kind
    if bag_suffix(head):
        return "bag"
    if _PCD.match(head[:4096]):
        return "pcd"
    return "ptx" if _PTX.match(head[:1024]) else None


def _unreadable(head: bytes, suffix: str) -> str | None:
    """Return what content that no magic number names looks like, None for text that may be points."""
    for magic, name in REFUSED:
        if head.startswith(magic):
            return f"this is {name}"
    if suffix in REFUSED_NAMES:
        return f"this is {REFUSED_NAMES[suffix]}"
    if suffix in HEADERS:
        return f"no {HEADERS[suffix]} header: the file is damaged, or its name is wrong"
    return "this is binary data of an unknown kind" if b"\0" in head[:4096] else None
