"""Numbers out of text fields, and the refusals that every reader shares."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from prf.logs.readings import FloatArray
from prf.shell.errors import InputError
from prf.window import LARGEST_COORDINATE

LARGEST_TIME = 1e20
"""Seconds. Beyond any clock, nanoseconds taken for seconds included, and safe to subtract."""

MANY_KINDS = 20
"""Odd kinds of line that are counted one by one; a damaged file may have thousands."""

MEND = "Remove or mend this line and run again."


def as_floats(fields: Sequence[bytes]) -> FloatArray | None:
    """Return text fields as float64; None if one is not a number in the C notation (so ``1_0`` is none)."""
    try:
        numbers = np.array(fields, dtype=np.float64)
    except ValueError:
        return None
    return None if b"_" in b" ".join(fields) else numbers


def parse_floats(fields: Sequence[bytes], where: str) -> FloatArray:
    """Return text fields as float64.

    Parameters
    ----------
    fields : sequence of bytes
        One number each.
    where : str
        ``file:line``, for the message.

    Raises
    ------
    InputError
        If a field is not a number in the C notation (so ``1_0`` is none).
    """
    numbers = as_floats(fields)
    if numbers is None:
        bad = next(i for i, text in enumerate(fields) if not is_number(text))
        raise InputError(f"{where}: {show(fields[bad])} is not a number. {MEND}")
    return numbers


def is_number(text: bytes) -> bool:
    """Return whether a text field reads as a C number."""
    try:
        float(text)
    except ValueError:
        return False
    return b"_" not in text


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
    """Refuse a sensor pose (x, y, heading) that is not finite or lies beyond `LARGEST_COORDINATE`."""
    if not np.all(np.isfinite(pose)):
        raise InputError(f"{where}: sensor pose ({', '.join(f'{v:g}' for v in pose)}) is not finite. {MEND}")
    if np.max(np.abs(pose)) > LARGEST_COORDINATE:
        raise InputError(
            f"{where}: sensor pose ({', '.join(f'{v:g}' for v in pose)}) lies beyond {LARGEST_COORDINATE:g} m. {MEND}"
        )


def check_time(time: float, where: str) -> float:
    """Return a time stamp in seconds, refused if it is not finite or lies beyond `LARGEST_TIME`."""
    if not abs(time) <= LARGEST_TIME:
        raise InputError(f"{where}: time stamp {time:g} is not finite. {MEND}")
    return time


def show(text: bytes) -> str:
    """Return a text field for a message: quoted, short, one line."""
    shown = text[:24].decode("ascii", "backslashreplace")
    return repr(shown + ("..." if len(text) > 24 else ""))


def count_odd_kind(odd: Counter[str], kind: bytes) -> None:
    """Count a line of an unknown kind, under "others" once :data:`MANY_KINDS` have been counted one by one."""
    shown = show(kind).strip("'\"")
    odd[shown if shown in odd or len(odd) < MANY_KINDS else "others"] += 1
