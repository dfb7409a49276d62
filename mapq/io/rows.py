"""Rows of numbers as text: the quick parse, and the search for the line at fault when it fails."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mapq.io.fields import Array
from prf.shell.errors import InputError

_SLASHES = re.compile(rb"//[^\r\n]*")


class Layout(NamedTuple):
    """How the rows of a text look.

    Attributes
    ----------
    dtype : structured dtype
        One field a column that is taken.
    width : int
        Columns in the file.
    used : tuple of int
        The columns that are taken, ascending.
    delimiter : str or None
        None is any run of blanks.
    comments : bool
        Whether ``#`` and ``//`` begin a comment.
    """

    dtype: np.dtype[np.void]
    width: int
    used: tuple[int, ...]
    delimiter: str | None = None
    comments: bool = False


def parse_rows(body: bytes, layout: Layout, source: str, first_line: int, n_rows: int | None = None) -> Array:
    """Return the rows of a text as a structured array (n,).

    Parameters
    ----------
    body : bytes
        The rows; blank ones are passed over.
    layout : Layout
    source : str
        Name of the file, for messages.
    first_line : int
        Line of the file on which `body` begins.
    n_rows : int, optional
        As many rows are read and no more; by default all.

    Raises
    ------
    InputError
        Naming the first line that has another number of columns, or something that is not a number.
    """
    if layout.comments and b"//" in body:
        body = _SLASHES.sub(b"", body)
    partial = len(layout.used) < layout.width
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "input contained no data": the callers count rows
            # What numpy refuses by now it read as a float before, and 256 as the byte 0.
            warnings.filterwarnings("error", ".*integer via a float", DeprecationWarning)
            return np.loadtxt(
                io.BytesIO(body),
                dtype=layout.dtype,
                comments="#" if layout.comments else None,
                delimiter=layout.delimiter,
                usecols=layout.used if partial else None,
                ndmin=1,
                max_rows=n_rows,
            )
    except (ValueError, IndexError, OverflowError) as error:
        raise _fault(body, layout, source, first_line) or InputError(
            f"{source}: the rows cannot be read ({error})."
        ) from None


def split_row(text: str, delimiter: str | None) -> list[str]:
    """Return the fields of a row, without blanks round them."""
    return [part.strip() for part in text.split(delimiter)]


def is_number(text: str) -> bool:
    """Return whether a field reads as a C number."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text.isascii()


def as_count(text: str) -> int | None:
    """Return a field as a whole number of at least 0, None if it is none (or has more than 15 digits)."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 16 else None


def _fault(body: bytes, layout: Layout, source: str, first_line: int) -> InputError | None:
    """Return the error for the first line that breaks the layout, None if there is none."""
    for number, text in _content(body, layout.comments):
        fields = split_row(text, layout.delimiter)
        where = f"{source}:{first_line + number}"
        if len(fields) < layout.used[-1] + 1 or (len(fields) != layout.width == len(layout.used)):
            return InputError(f"{where}: {len(fields)} columns, but {layout.width} before. Remove or mend this line.")
        wrong = _wrong_field([fields[column] for column in layout.used], layout.dtype)
        if wrong is not None:
            name, value = wrong
            return InputError(f"{where}: {name} is {_show(value)}, {_complaint(value, layout.dtype[name])}")
    return None


def _content(body: bytes, comments: bool) -> Iterator[tuple[int, str]]:
    """Yield number (from 0) and text of the lines that are not blank."""
    for number, line in enumerate(body.split(b"\n")):
        text = line.decode("utf-8", "replace")
        text = text.partition("#")[0].strip() if comments else text.strip()
        if text:
            yield number, text


def _wrong_field(values: Sequence[str], dtype: np.dtype[np.void]) -> tuple[str, str] | None:
    for name, value in zip(dtype.names or (), values, strict=True):
        if not _fits(value, dtype[name]):
            return name, value
    return None


def _fits(value: str, dtype: np.dtype[np.generic]) -> bool:
    if dtype.kind == "f":
        return is_number(value)
    limits = np.iinfo(dtype.str)
    try:
        return is_number(value) and limits.min <= int(value) <= limits.max
    except ValueError:
        return False


def _complaint(value: str, dtype: np.dtype[np.generic]) -> str:
    if not value:
        return "not a number. Write nan where there is no value."
    if not is_number(value):
        comma = " Decimals need a point, not a comma." if re.fullmatch(r"[-+]?\d+,\d+", value) else ""
        return f"not a number.{comma} Remove or mend this line."
    return f"which does not fit the type {dtype}. Mend the header or this line."


def _show(text: str) -> str:
    return repr(text[:24] + ("..." if len(text) > 24 else ""))
