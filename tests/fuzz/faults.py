"""Strategies of hypothesis for structured damage: one fault in a whole file."""

from __future__ import annotations

import gzip
import io
import re
import struct
import zipfile
from typing import Any

from hypothesis import strategies as st

NUMBER = re.compile(rb"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
TEXTS = (
    *(b"nan", b"-nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", b"0", b"-0.0", b"-1", b"-7.5"),
    *(b"1000000000000", b"99999999999999999999", b"9" * 5000, b"", b"x", b"1_0", b"0x1F", b"1,5", b"\0", b"'", b"null"),
)
COUNTS = (0, 1, 2, 255, 65535, 2**31 - 1, 2**31, 2**32 - 1, 10**12, 2**63 - 1, 2**63, 2**64 - 1)
REALS = (float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, 0.0, -1.0, 1e12)
WIDTHS = ("<H", "<I", "<Q", ">I")
BOMB = 1 << 27
"""Bytes that a bomb of 130 kB unpacks to."""


def numbers_of(data: bytes) -> list[tuple[int, int]]:
    """Return where numbers stand as text, the first 400."""
    return [found.span() for _, found in zip(range(400), NUMBER.finditer(data), strict=False)]


@st.composite
def truncated(draw: Any, data: bytes) -> bytes:
    """Cut a file off anywhere."""
    return data[: draw(st.integers(0, max(0, len(data) - 1)))]


@st.composite
def renumbered(draw: Any, data: bytes) -> bytes:
    """Put another number, or none, where one stands as text: counts, ranges, coordinates."""
    places = numbers_of(data)
    if not places:
        return draw(truncated(data))
    begin, end = places[draw(st.integers(0, len(places) - 1))]
    return data[:begin] + draw(st.sampled_from(TEXTS)) + data[end:]


@st.composite
def repacked(draw: Any, data: bytes) -> bytes:
    """Put another count or another real number over bytes, in the head more often."""
    limit = draw(st.sampled_from((64, 400, len(data))))
    at = draw(st.integers(0, max(0, min(limit, len(data)) - 1)))
    if draw(st.booleans()):
        code = draw(st.sampled_from(WIDTHS))
        piece = struct.pack(code, draw(st.sampled_from(COUNTS)) % (1 << 8 * struct.calcsize(code)))
    else:
        code = draw(st.sampled_from(("<f", "<d")))
        value = draw(st.sampled_from(REALS))
        piece = struct.pack(code, value if code == "<d" or abs(value) < 3e38 else float("inf"))
    return data[:at] + piece + data[at + len(piece) :]


@st.composite
def pierced(draw: Any, data: bytes) -> bytes:
    """Put bytes of NUL, or of no text, anywhere."""
    at = draw(st.integers(0, len(data)))
    return data[:at] + draw(st.sampled_from((b"\0", b"\0" * 100, b"\xff\xfe", b"\x1b[2J", b"\r"))) + data[at:]


@st.composite
def doubled(draw: Any, data: bytes) -> bytes:
    """Have a line twice, or leave it out."""
    lines = data.splitlines(keepends=True) or [b""]
    at = draw(st.integers(0, len(lines) - 1))
    lines[at : at + 1] = draw(st.sampled_from(([], [lines[at]] * 2, [lines[at], b"\n"])))
    return b"".join(lines)


def bomb(data: bytes) -> bytes:
    """Return a gzip file of 130 kB that begins as `data` does and unpacks to much more."""
    return gzip.compress(data + b" " * BOMB, mtime=0)


@st.composite
def repacked_member(draw: Any, data: bytes) -> bytes:
    """Damage one member of a zip archive, under a check sum that is right, or its name."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    at = draw(st.integers(0, len(members) - 1))
    name, content = members[at]
    names = st.sampled_from((name, name, name, "../../slipped.npy", "/tmp/slipped.npy", "a/../../slipped"))
    members[at] = (draw(names), draw(st.one_of(st.just(content), plain_faults(content))))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for each, value in members:
            archive.writestr(each, value)
    return stream.getvalue()


def plain_faults(data: bytes) -> st.SearchStrategy[bytes]:
    """Return the faults of a file that is no archive."""
    return st.one_of(truncated(data), renumbered(data), repacked(data), pierced(data), doubled(data))


def faults(data: bytes) -> st.SearchStrategy[bytes]:
    """Return all faults that a whole file can have."""
    if data.startswith(b"PK"):
        return st.one_of(repacked_member(data), repacked_member(data), plain_faults(data))
    return plain_faults(data)
