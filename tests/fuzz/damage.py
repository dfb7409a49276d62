"""Damage to whole files: cut, spliced, numbers changed; archives are opened for it and closed again."""

from __future__ import annotations

import gzip
import io
import random
import re
import struct
import zipfile
import zlib

PIECES = (
    *(b"", b" ", b"\n", b"\r\n", b"\t", b",", b";", b"#", b"-", b".", b"\0", b"\0" * 40, b"\xff" * 8, b"\x1b[31m"),
    *(b"nan", b"NaN", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"1e999", b"-1", b"0", b"1e30", b"_", b"null"),
    *(b"{", b"}", b"[", b"]", b'"', b"[" * 3000, b"9" * 5000, b"true", b"1_000", b"0x10", b"1.5", b"--", b"()", b"'"),
    *("ü \u2028 \u0085 \U0001f600".encode(), b"\xef\xbb\xbf", b"../../x", b"/dev/zero", b"%s", b"\\n", b"a b"),
)
NUMBERS = (0, 1, -1, 2, 3, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 10**9, 10**12, 2**62, 2**63, 2**64 - 1)
BITS = (0.0, -0.0, 1.0, -1.0, 1e308, -1e308, 1e-308, 1e30, 1e15, float("inf"), float("-inf"), float("nan"))
PAGE = 1024
"""Bytes of a page of E57, the last four a check sum."""


def damaged(data: bytes, rng: random.Random, largest: int = 1 << 16) -> bytes:
    """Return `data` with one to four faults."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        data = _inside(data, rng)
    return data[:largest]


def _inside(data: bytes, rng: random.Random) -> bytes:
    """Damage what is within an archive, or the file itself."""
    if rng.random() < 0.8:
        try:
            if data.startswith(b"PK"):
                return _in_zip(data, rng)
            if data.startswith(b"\x1f\x8b"):
                return gzip.compress(_once(gzip.decompress(data), rng), mtime=0)
            if data.startswith(b"ASTM-E57"):
                return _in_e57(data, rng)
        except (OSError, EOFError, ValueError, zlib.error, zipfile.BadZipFile, RuntimeError, struct.error):
            pass
        except (NotImplementedError, MemoryError):
            pass
    return _once(data, rng)


def _once(data: bytes, rng: random.Random) -> bytes:
    fault = rng.choice((_cut, _splice, _splice, _number, _number, _number, _binary, _binary, _repeat, _swap, _line))
    return fault(data, rng)


def _place(data: bytes, rng: random.Random) -> int:
    """Return a place, more often one near the beginning, where headers are."""
    return rng.randrange(min(len(data), 400) + 1) if rng.random() < 0.5 else rng.randrange(len(data) + 1)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _splice(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    piece = rng.choice(PIECES) if rng.random() < 0.8 else rng.randbytes(rng.randrange(8))
    return data[:at] + piece + data[at + rng.choice((0, 0, len(piece), rng.randrange(12))) :]


def _number(data: bytes, rng: random.Random) -> bytes:
    """Put another number where one stands as text."""
    at = _place(data, rng)
    found = re.compile(rb"[-+.\deE]*\d").search(data, at) or re.compile(rb"\d+").search(data)
    if found is None:
        return _splice(data, rng)
    text = rng.choice((str(rng.choice(NUMBERS)).encode(), rng.choice(PIECES), str(rng.choice(BITS)).encode()))
    return data[: found.start()] + text + data[found.end() :]


def _binary(data: bytes, rng: random.Random) -> bytes:
    """Put another number where bytes may be one."""
    code = rng.choice(("<B", "<H", "<I", "<Q", "<f", "<d", ">I", ">Q", ">f", ">d"))
    value = rng.choice(BITS) if code[1] in "fd" else rng.choice(NUMBERS) % (1 << 8 * struct.calcsize(code))
    try:
        piece = struct.pack(code, value)
    except OverflowError:
        piece = struct.pack(code, float("inf"))
    at = _place(data, rng)
    return data[:at] + piece + data[at + len(piece) :]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    at = _place(data, rng)
    end = min(len(data), at + rng.choice((1, 4, 16, 100, 1000)))
    return data[:end] + data[at:end] * rng.choice((1, 1, 2, 10)) + data[end:]


def _swap(data: bytes, rng: random.Random) -> bytes:
    """Put one part of the file over another."""
    n = rng.choice((1, 4, 8, 30))
    source, at = _place(data, rng), _place(data, rng)
    return data[:at] + data[source : source + n] + data[at + n :]


def _line(data: bytes, rng: random.Random) -> bytes:
    """Take a line away, or have it twice, or put it elsewhere."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.choice((0, 1, 2))):
        lines.insert(rng.randrange(len(lines) + 1), line)
    return b"".join(lines)


def _in_zip(data: bytes, rng: random.Random) -> bytes:
    """Damage a member, its name or its packing, under check sums that are right."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    number = rng.randrange(len(members))
    name, content = members[number]
    fault = rng.random()
    if fault < 0.8:
        members[number] = (name, _once(content, rng))
    elif fault < 0.9:
        del members[number]
    else:
        members[number] = (rng.choice(("../../x.npy", "/x.npy", "x\n.npy", name, f"a{name}", members[0][0])), content)
    stream = io.BytesIO()
    packing = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    with zipfile.ZipFile(stream, "w", packing) as archive:
        for each, value in members:
            if each not in archive.namelist():
                archive.writestr(each, value)
    return stream.getvalue()


def _in_e57(data: bytes, rng: random.Random) -> bytes:
    """Damage the pages of an E57 file, under check sums that are right."""
    inner = b"".join(data[at : at + PAGE - 4] for at in range(0, len(data), PAGE))
    inner = _once(inner, rng)
    pages = [inner[at : at + PAGE - 4].ljust(PAGE - 4, b"\0") for at in range(0, len(inner), PAGE - 4)]
    return b"".join(page + struct.pack(">I", crc32c(page)) for page in pages)


def _table() -> list[int]:
    table = []
    for number in range(256):
        value = number
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
        table.append(value)
    return table


_TABLE = _table()


def crc32c(data: bytes) -> int:
    """Return the check sum of Castagnoli."""
    value = 0xFFFFFFFF
    for byte in data:
        value = (value >> 8) ^ _TABLE[(value ^ byte) & 0xFF]
    return value ^ 0xFFFFFFFF
