"""Rows of numbers as text: numpy's parser, and the search for the line at fault when it fails."""

from __future__ import annotations

import io
import re
import warnings
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
        One field for each used column.
    width : int
        Columns in the file.
    used : tuple of int
        Columns that are read, ascending.
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

    @classmethod
    def of(cls, dtype: np.dtype[np.void]) -> Layout:
        """Return the layout of rows that have the fields of `dtype` and nothing else, between blanks."""
        width = len(dtype.names or ())
        return cls(dtype, width, tuple(range(width)))


def parse_rows(body: bytes, layout: Layout, source: str, first_line: int, n_rows: int | None = None) -> Array:
    """Return the rows of a text as a structured array (n,); blank lines are skipped.

    Parameters
    ----------
    body : bytes
    layout : Layout
    source : str
        Name of the file, for messages.
    first_line : int
        Line of the file on which `body` begins.
    n_rows : int, optional
        Rows to read; by default all.
    """
    if layout.comments and b"//" in body:
        body = _SLASHES.sub(b"", body)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # "input contained no data": the callers count rows
            # What numpy refuses by now it once read as a float, and 256 as the byte 0.
            warnings.filterwarnings("error", ".*integer via a float", DeprecationWarning)
            return np.loadtxt(
                io.BytesIO(body),
                dtype=layout.dtype,
                comments="#" if layout.comments else None,
                delimiter=layout.delimiter,
                usecols=layout.used if len(layout.used) < layout.width else None,
                ndmin=1,
                max_rows=n_rows,
            )
    except (ValueError, IndexError, OverflowError) as error:
        line, text = _line_at_fault(body, layout, first_line)
        what = f"{text[:40]!r} does not hold {layout.width} numbers" if line else f"the rows cannot be read ({error})"
        where = f"{source}:{line}" if line else source
        raise InputError(f"{where}: {what}. Remove or mend this line; decimals need a point.") from None


def split_row(text: str, delimiter: str | None) -> list[str]:
    """Return the fields of a row, without blanks around them."""
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


def _line_at_fault(body: bytes, layout: Layout, first_line: int) -> tuple[int, str]:
    """Return number and text of the first line that breaks the layout; 0 if there is none."""
    whole = [layout.dtype[name].kind != "f" for name in layout.dtype.names or ()]
    for number, line in enumerate(body.split(b"\n"), first_line):
        text = line.decode("utf-8", "replace").strip()
        if layout.comments:
            text = text.partition("#")[0].strip()
        fields = split_row(text, layout.delimiter)
        some = [fields[column] for column in layout.used if column < len(fields)]
        fits = len(some) == len(layout.used) and (len(fields) == layout.width or len(some) < layout.width)
        if text and not (fits and all(is_number(each) for each in some)):
            return number, text
        if text and any(_is_beyond(*each, layout.dtype) for each in enumerate(some) if whole[each[0]]):
            return number, text
    return 0, ""


def _is_beyond(place: int, text: str, dtype: np.dtype[np.void]) -> bool:
    """Return whether a number does not fit the whole type of its field."""
    limits = np.iinfo(dtype[place].str)
    try:
        return not limits.min <= int(text) <= limits.max
    except ValueError:
        return True
