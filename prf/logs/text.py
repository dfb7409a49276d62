"""Numbers and tables out of text, with refusals that name file and line; shared by every reader of text logs."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.logs.readings import FloatArray, IntArray
from prf.shell.errors import InputError
from prf.shell.gzipped import gunzip
from prf.window import LARGEST_COORDINATE

GZIP_MAGIC = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""
MAX_TIME = 1e20
"""Seconds. Beyond any clock, nanoseconds taken for seconds included, and safe to subtract."""
MAX_KINDS = 20
"""Odd kinds of line that are counted one by one; a damaged file may have thousands."""
BLOCK = 65536
"""Rows of a table parsed at a time, so that the text fields of a long one are never all in memory."""
MEND = "Remove or mend this line and run again."


def decompress(data: bytes, source: str) -> bytes:
    """Return `data`, decompressed if it is gzipped; `source` names it in the error if it is damaged or too large."""
    return gunzip(data, source) if data.startswith(GZIP_MAGIC) else data


def as_floats(fields: Sequence[bytes]) -> FloatArray | None:
    """Return text fields as float64; None if one is not a number in the C notation (so ``1_0`` is none)."""
    try:
        numbers = np.array(fields, dtype=np.float64)
    except ValueError:
        return None
    return None if b"_" in b" ".join(fields) else numbers


def is_number(text: bytes) -> bool:
    """Return whether a text field reads as a C number."""
    return as_floats([text]) is not None


def parse_floats(fields: Sequence[bytes], where: str) -> FloatArray:
    """Return text fields as float64; `where` is ``file:line``, for the message if one is no number."""
    numbers = as_floats(fields)
    if numbers is None:
        bad = next(text for text in fields if not is_number(text))
        raise InputError(f"{where}: {show(bad)} is not a number. {MEND}")
    return numbers


def parse_count(text: bytes, where: str, what: str) -> int:
    """Return a text field as a whole number of at least 0, or raise `InputError`."""
    if not text.isdigit() or len(text) > 9:
        raise InputError(f"{where}: {what} is {show(text)}, which is not a count. {MEND}")
    return int(text)


def check_ranges(ranges: FloatArray, where: str) -> None:
    """Refuse a scan with a range that is nan or negative, naming the beam."""
    bad = np.flatnonzero(~(ranges >= 0))
    if len(bad):
        beam = int(bad[0])
        what = "is not a number" if np.isnan(ranges[beam]) else "is negative"
        raise InputError(f"{where}: range {ranges[beam]:g} (beam {beam}) {what}. {MEND}")


def check_pose(pose: FloatArray, where: str) -> None:
    """Refuse sensor poses with a coordinate that is not finite or lies beyond `LARGEST_COORDINATE`."""
    if not np.max(np.abs(pose), initial=0.0) <= LARGEST_COORDINATE:
        what = f"lies beyond {LARGEST_COORDINATE:g} m" if np.isfinite(pose).all() else "is not finite"
        raise InputError(f"{where}: sensor pose ({', '.join(f'{v:g}' for v in pose.flat)}) {what}. {MEND}")


def check_time(time: float, where: str) -> float:
    """Return a time stamp in seconds, refused if it is not finite or lies beyond `MAX_TIME`."""
    if not abs(time) <= MAX_TIME:
        raise InputError(f"{where}: time stamp {time:g} is not finite. {MEND}")
    return time


def show(text: bytes) -> str:
    """Return a text field for a message: quoted, short, one line."""
    shown = text[:24].decode("ascii", "backslashreplace")
    return repr(shown + ("..." if len(text) > 24 else ""))


def count_odd_kind(odd: Counter[str], kind: bytes) -> None:
    """Count a line of an unknown kind, under "others" once `MAX_KINDS` have been counted one by one."""
    shown = show(kind).strip("'\"")
    odd[shown if shown in odd or len(odd) < MAX_KINDS else "others"] += 1


class Rows(NamedTuple):
    """The known columns of a CSV table.

    Attributes
    ----------
    source : str
        Name of the table, for messages.
    line : (n,) int64
        Number of each row in the file.
    columns : dict of str to (n,) float64
    n_unknown : int
        Further columns.
    """

    source: str
    line: IntArray
    columns: dict[str, FloatArray]
    n_unknown: int

    def require(self, name: str, low: float, high: float, words: str, also: NDArray[np.bool_] | bool = False) -> None:
        """Refuse the first value of a column that lies outside [low, high] and is not `also` allowed."""
        values = self.columns[name]
        bad = np.flatnonzero(~((values >= low) & (values <= high)) & ~np.asarray(also))
        if len(bad):
            at = f"{self.source}:{self.line[bad[0]]}"
            raise InputError(f"{at}: {name} is {values[bad[0]]:g}, but must be {words}. {MEND}")


def content_lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and text of every line that is neither blank nor a comment (``#``)."""
    for number, line in enumerate(io.BytesIO(data), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith(b"#"):
            yield number, line.rstrip(b"\r\n")


def column_names(line: bytes) -> list[str]:
    """Return the names in a header line, lower case, without blanks and quotes."""
    return [name.strip(" \t\"'").lower() for name in line.decode("utf-8", "replace").split(",")]


def read_rows(
    data: bytes, source: str, required: Sequence[str], optional: Sequence[str], empty: Mapping[str, bytes], advice: str
) -> Rows:
    """Return the known columns of a CSV table with a header; blank lines and comments are skipped.

    Parameters
    ----------
    source : str
        Name of the table, for messages.
    required, optional : sequence of str
        Names of columns, read without case; others are counted.
    empty : mapping of str to bytes
        What an empty field of a column stands for; in every other column it is an error.
    advice : str
        What to do about a header that lacks a column.
    """
    lines = content_lines(data)
    first, header = next(lines, (1, b""))
    names = column_names(header)
    known = [name for name in names if name in (*required, *optional)]
    doubled = sorted({name for name in known if known.count(name) > 1})
    missing = [name for name in required if name not in known]
    if missing or doubled:
        what = f"no column {', '.join(missing)}" if missing else f"column {', '.join(doubled)} twice"
        raise InputError(f"{source}:{first}: the header has {what}. {advice}")
    numbers, parts = [np.zeros(0, np.int64)], {name: [np.zeros(0)] for name in known}
    while block := list(islice(lines, BLOCK)):
        numbers.append(np.array([number for number, _ in block], dtype=np.int64))
        fields = _fields(block, len(names), source)
        for name in known:
            texts = fields[names.index(name) :: len(names)]
            if name in empty:
                texts = [text if text and not text.isspace() else empty[name] for text in texts]
            parts[name].append(_column(texts, name, numbers[-1], source))
    columns = {name: np.concatenate(blocks) for name, blocks in parts.items()}
    return Rows(source, np.concatenate(numbers), columns, len(names) - len(known))


def _fields(block: Sequence[tuple[int, bytes]], width: int, source: str) -> list[bytes]:
    """Return the fields of rows, row by row."""
    for number, line in block:
        if line.count(b",") != width - 1:
            has = line.count(b",") + 1
            raise InputError(f"{source}:{number}: row of {has} fields under a header of {width}. {MEND}")
    return b",".join(line for _, line in block).split(b",")


def _column(fields: list[bytes], name: str, number: IntArray, source: str) -> FloatArray:
    values = as_floats(fields)
    if values is None:
        bad = next(i for i, text in enumerate(fields) if not is_number(text))
        raise InputError(f"{source}:{number[bad]}: {name} is {show(fields[bad].strip())}, not a number. {MEND}")
    return values
