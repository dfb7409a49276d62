"""Which format a log has, from its content alone; what cannot be read is named, so that users know what they have."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

from prf.logs.carmen import KNOWN_KINDS
from prf.logs.columns import column_names
from prf.logs.numbers import is_number
from prf.logs.table import REQUIRED
from prf.shell.errors import InputError

Format = Literal["carmen", "player", "table"]

ACCEPTED = (
    "Accepted are CARMEN logs with laser poses, Player logs, ROS bags, and CSV tables with the columns "
    "x,y,theta,range; also gzipped."
)

LINES_TRIED = 2000
"""A text log may begin with hundreds of lines that an older tool wrote; a known first field comes within these."""

MAGICS = (
    (b"#ROSBAG", "a ROS 1 bag of an old version, which rosbag fix can convert"),
    (b"#ROSRECORD", "a ROS 1 bag of a version before 1.3, which rosbag fix can convert"),
    (b"\x1f\x8b", "a file that was gzipped twice"),
    (b"BZh", "a bzip2 archive"),
    (b"\xfd7zXZ", "an xz archive"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"%PDF", "a PDF document"),
    (b"P5", "a PGM picture"),
    (b"ply\n", "a PLY point cloud"),
    (b"ply\r\n", "a PLY point cloud"),
    (b"# .PCD", "a PCD point cloud"),
    (b"{", "a JSON document"),
    (b"<", "an XML or HTML document"),
)

_PLAYER = re.compile(rb"^## Player version|^\d+\.\d+ \S+ \d+ (laser|sonar|position(2d)?) \d+", re.MULTILINE)
_ODOMETRY = re.compile(rb"^Odometry\s+[-+\d.e]+\s+[-+\d.e]+\s+[-+\d.e]+\s*$", re.MULTILINE)
_CARMEN_HEADER = re.compile(rb"^#+\s*message formats defined:", re.MULTILINE)


def recognise(data: bytes, source: str) -> Format:
    """Return the format of decompressed content that is no bag.

    Parameters
    ----------
    data : bytes
        The content.
    source : str
        Its name, for the message.

    Raises
    ------
    InputError
        If no reader takes it; the line says what it looks like and what is accepted.
    """
    looks_like = _by_magic(data)
    if looks_like is None:
        head = _head(data)
        if _is_table(head):
            return "table"
        if _PLAYER.search(head):
            return "player"
        if _is_carmen(head):
            return "carmen"
        looks_like = _text_of(head)
    raise InputError(f"{source}: {looks_like}. {ACCEPTED}")


def _by_magic(data: bytes) -> str | None:
    if not data.strip():
        return "the file is empty"
    for magic, name in MAGICS:
        if data.startswith(magic):
            return f"this is {name}"
    if b"\0" in data:
        return "this is binary data of an unknown kind"
    return None


def _head(data: bytes) -> bytes:
    """Return the first `LINES_TRIED` lines."""
    end = -1
    for _ in range(LINES_TRIED):
        end = data.find(b"\n", end + 1)
        if end < 0:
            return data
    return data[:end]


def _content(head: bytes) -> Iterator[bytes]:
    return (line for line in head.splitlines() if line.strip() and not line.lstrip().startswith(b"#"))


def _is_table(head: bytes) -> bool:
    names = column_names(next(_content(head), b""))
    return sum(name in names for name in REQUIRED) >= 2


def _is_carmen(head: bytes) -> bool:
    if _CARMEN_HEADER.search(head):
        return True
    return any(line.split(None, 1)[0].decode("latin-1") in KNOWN_KINDS for line in _content(head))


def _text_of(head: bytes) -> str:
    """Return what unreadable text looks like."""
    if _ODOMETRY.search(head):
        return (
            "this is an unlocalized log: its scans come with odometry, not with corrected sensor poses. "
            "Localize it first (by scan matching or SLAM)"
        )
    first = next(_content(head), b"")
    if set(REQUIRED) <= set(re.split(r"[;\s|]+", first.decode("latin-1").lower())):
        return "this is a table whose columns are not separated by commas"
    fields = first.split(b",")
    if len(fields) > 1 and all(is_number(text) for text in fields if text.strip()):
        return "this is a CSV table without a header line"
    return "this is text of an unknown format"
