"""Ranges alone: a text or an array of numbers, one scan a row, as MATLAB and numpy write them; poses come from a file.

The directions of the columns are not in it: they are given, counter-clockwise from straight ahead. ``inf`` is no
return; 0 and nan are no measurement, dropped and counted.
"""

from __future__ import annotations

import re

import numpy as np

from prf.readings.readings import LogNotes, Readings, ScanTable
from prf.readings.text import MEND, FloatArray, IntArray, check_domains, content_lines
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.files import NUMPY_MAGIC, array_of

FEWEST = 9
"""Numbers in a row that may be ranges: fewer are a pose, or little else than text."""


def beam_directions(text: str) -> FloatArray:
    """Return the directions (n,) of FIRST:STEP:LAST in degrees, in radians; the last one is among them if steps do."""
    try:
        first, step, last = map(float, text.split(":"))
        n = int(np.floor((last - first) / step + 1e-6)) + 1
        if not (n > 0 and np.isfinite([first, step, last]).all() and abs(step) * n <= 720.0):
            raise ValueError
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ConfigError(f"--beam-angles {text}: must be FIRST:STEP:LAST in degrees, such as -90:1:89.") from None
    return np.asarray(np.radians(first + step * np.arange(n)))


def looks_like_matrix(data: bytes, fewest: int = FEWEST) -> bool:
    """Return whether data are an array of numpy, or a text whose first two lines are as many numbers, not too few."""
    if data.startswith(NUMPY_MAGIC):
        return True
    rows = [_fields(line) for _, line in zip(range(2), (line for _, line in content_lines(data)), strict=False)]
    return bool(rows) and all(len(row) >= fewest and len(row) == len(rows[0]) and _are_numbers(row) for row in rows)


def size_of(data: bytes, source: str) -> tuple[int, int]:
    """Return how many scans a matrix has, and how many numbers in each."""
    if data.startswith(NUMPY_MAGIC):
        rows, columns = array_of(data, source).shape
        return rows, columns
    lines = [line for _, line in content_lines(data)]
    return len(lines), len(_fields(lines[0]))


def read_matrix(data: bytes, source: str, angles: str) -> Readings:
    """Read ranges as they are on the sensor, decompressed, with the directions `angles` (:func:`beam_directions`)."""
    direction = beam_directions(angles)
    line, ranges = _rows(data, source)
    n, width = ranges.shape
    if width != len(direction):
        raise InputError(f"{source}: {width} ranges a row, but --beam-angles {angles} are {len(direction)} directions.")
    check_domains(source, np.repeat(line, width), {"range": ranges.ravel()}, nan=("range",))
    usable = ranges.ravel() > 0.0
    if not usable.any():
        raise InputError(f"{source}: no range is above 0. Give readings with a distance.")
    scan = np.repeat(np.arange(n), width)
    zero = np.zeros(n, np.int64)
    notes = LogNotes(
        format="ranges",
        poses="the sensor",
        scans=ScanTable(np.arange(n), line, np.full(n, width), zero, np.zeros((n, 3)), np.full(n, np.nan)),
        devices=("ranges",),
        n_zero_ranges=int(np.count_nonzero(ranges == 0.0)),
        n_invalid=int(np.count_nonzero(np.isnan(ranges))),
    )
    return Readings.from_arrays(
        np.zeros((n * width, 2)),
        np.tile(direction, n),
        ranges.ravel(),
        scan=scan,
        beam=np.tile(np.arange(width), n),
        source=source,
        notes=notes,
    ).where(usable)


def _rows(data: bytes, source: str) -> tuple[IntArray, FloatArray]:
    """Return the lines of the scans (n,) and their ranges (n, w)."""
    if data.startswith(NUMPY_MAGIC):
        values = array_of(data, source)
        return np.arange(len(values)), values
    lines, rows = [], list[list[bytes]]()
    for number, text in content_lines(data):
        fields = _fields(text)
        if rows and len(fields) != len(rows[0]):
            raise InputError(f"{source}:{number}: {len(fields)} ranges, but {len(rows[0])} before. {MEND}")
        if not _are_numbers(fields):
            raise InputError(f"{source}:{number}: a range is not a number. {MEND}")
        lines.append(number)
        rows.append(fields)
    return np.array(lines), np.array(rows, np.float64)


def _fields(line: bytes) -> list[bytes]:
    return [field for field in re.split(rb"[\s,;]+", line) if field]


def _are_numbers(fields: list[bytes]) -> bool:
    try:
        np.array(fields, np.float64)
    except ValueError:
        return False
    return True
