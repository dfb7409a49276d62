"""Ranges alone: a text or an array of numbers, one scan a row, as MATLAB and numpy write them; poses come from a file.

The directions of the columns are given, counter-clockwise from straight ahead, unless a file of several arrays (.mat,
.npz) has them. A text may begin with a line of names, one a column. A first column that rises, beside the ranges, or
that is called so, is the time. ``inf`` is no return; 0 and nan are no measurement, dropped and counted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from prf.readings.readings import LogNotes, Readings, ScanTable
from prf.readings.text import MEND, FloatArray, IntArray, check_domains, content_lines
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.files import NUMPY_MAGIC, array_of, in_seconds, pose_columns, table_cells
from prf.shell.poses.named import ODOMETRY, is_named, named_arrays

FEWEST = 9
"""Numbers in a row that may be ranges: fewer are a pose, or little else than text."""
POSE_MATRICES = (12, 16)
"""Numbers in a row that may be a matrix: beside other ranges they are poses."""
FEWEST_TIMES = 20
"""Rising numbers in a first column that are times."""
OF_BEAMS = {"x", "y", "theta", "range"}
"""Names of columns of a table of a beam a row; two of them are one."""


class Ranges(NamedTuple):
    """What a file of ranges alone holds."""

    ranges: FloatArray  # (n, w) metres
    line: IntArray  # (n,) lines of the scans, or their rows
    time: FloatArray  # (n,) seconds, nan where unknown
    direction: FloatArray | None  # (w,) radians, if the file has them
    words: str  # what else there is to know, for a person
    time_unit: float | None = None  # seconds, of a first column that a header calls time


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
    if data.startswith(NUMPY_MAGIC) or is_named(data):
        return True
    rows = [_fields(line) for _, line in islice(_rows(data), 2)]
    return bool(rows) and all(len(row) >= fewest and len(row) == len(rows[0]) and _are_numbers(row) for row in rows)


def ranges_of(data: bytes, source: str, n_directions: int | None = None) -> Ranges:
    """Return the ranges in content, decompressed; scans are columns where only so there are `n_directions` in each."""
    if is_named(data):
        found = _named_ranges(data, source)
    elif data.startswith(NUMPY_MAGIC):
        found = _plain(array_of(data, source))
    else:
        found = _text_ranges(data, source)
    n, width = found.ranges.shape
    if n_directions == n != width:
        found = _plain(found.ranges.T)._replace(words="a scan a column")
    elif width != n_directions and (found.time_unit or n >= FEWEST_TIMES) and _rises(found.ranges[:, 0]):
        time = in_seconds(found.ranges[:, 0] * (found.time_unit or 1.0))
        found = found._replace(ranges=found.ranges[:, 1:], time=time, words="the first column is time")
    return found


def has_directions(data: bytes, source: str) -> bool:
    """Return whether content is ranges with the directions of their beams."""
    return is_named(data) and _named_ranges(data, source).direction is not None


def read_matrix(data: bytes, source: str, angles: str | None) -> Readings:
    """Read ranges as they are on the sensor, decompressed, with the directions `angles` (:func:`beam_directions`)."""
    direction = None if angles is None else beam_directions(angles)
    found = ranges_of(data, source, None if direction is None else len(direction))
    n, width = found.ranges.shape
    direction = found.direction if direction is None else direction
    assert direction is not None
    if width != len(direction):
        raise InputError(f"{source}: {width} ranges a row, but --beam-angles {angles} are {len(direction)} directions.")
    ranges = found.ranges.reshape(-1)
    check_domains(source, np.repeat(found.line, width), {"range": ranges}, nan=("range",))
    usable = ranges > 0.0
    if not usable.any():
        raise InputError(f"{source}: no range is above 0. Give readings with a distance.")
    zero = np.zeros(n, np.int64)
    notes = LogNotes(
        format="ranges",
        poses="the sensor",
        scans=ScanTable(np.arange(n), found.line, np.full(n, width), zero, np.zeros((n, 3)), found.time),
        devices=("ranges",),
        n_zero_ranges=int(np.count_nonzero(ranges == 0.0)),
        n_invalid=int(np.count_nonzero(np.isnan(ranges))),
        remarks=(found.words,) if found.words else (),
    )
    return Readings.from_arrays(
        np.zeros((n * width, 2)),
        np.tile(direction, n),
        ranges,
        scan=np.repeat(np.arange(n), width),
        beam=np.tile(np.arange(width), n),
        time=np.repeat(found.time, width),
        source=source,
        notes=notes,
    ).where(usable)


def _plain(ranges: FloatArray, line: IntArray | None = None) -> Ranges:
    n = len(ranges)
    return Ranges(ranges, np.arange(n) if line is None else line, np.full(n, np.nan), None, "")


def _text_ranges(data: bytes, source: str) -> Ranges:
    """Return the rows of a text."""
    lines, rows = [], list[list[bytes]]()
    for number, text in _rows(data):
        fields = _fields(text)
        if rows and len(fields) != len(rows[0]):
            raise InputError(f"{source}:{number}: {len(fields)} ranges, but {len(rows[0])} before. {MEND}")
        if not _are_numbers(fields):
            raise InputError(f"{source}:{number}: a range is not a number. {MEND}")
        lines.append(number)
        rows.append(fields)
    names = header_names(next(filter(None, map(bytes.strip, data.splitlines()))))
    _, time_unit = pose_columns(names[:1]).get("t", (0, None))
    found = _plain(np.array(rows, np.float64), np.array(lines))
    return found._replace(time_unit=time_unit if len(names) == len(rows[0]) else None)


def header_names(line: bytes) -> list[str]:
    """Return the names in a line that heads columns, a comment or not, without quotes."""
    return table_cells(line.decode("utf-8", "replace").lstrip("#% "))


def _rows(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield number and text of every line with content but a header: names, one a column, not those of other tables."""
    lines = content_lines(data)
    first, second = next(lines, None), next(lines, None)
    both = [each for each in (first, second) if each is not None]
    yield from chain(both[len(both) == 2 and _is_header(both[0][1], both[1][1]) :], lines)


def _is_header(first: bytes, second: bytes) -> bool:
    names, row = header_names(first), _fields(second)
    is_other = len(OF_BEAMS.intersection(map(str.lower, names))) >= 2 or {"x", "y"} <= pose_columns(names).keys()
    return not is_other and len(names) == len(row) and _are_numbers(row) and not _are_numbers(_fields(first))


def _rises(values: FloatArray) -> bool:
    return bool((np.diff(values) > 0.0).all())


def wide_arrays(arrays: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the arrays that may be ranges: of several neither matrices of poses nor the same row again and again."""
    wide = {name: values for name, values in arrays.items() if min(values.shape) >= FEWEST}
    if len(wide) == 1:
        return wide
    plain = {name: values for name, values in wide.items() if values.shape[1] not in POSE_MATRICES}
    return {name: values for name, values in plain.items() if (values != values[0]).any()}


def _named_ranges(data: bytes, source: str) -> Ranges:
    """Return the only array of a file of several that may be ranges, and what others there say of it."""
    arrays = named_arrays(data, source)
    wide = wide_arrays(arrays)
    if len(wide) != 1:
        found = ", ".join(f"{name} {n} x {w}" for name, (n, w) in ((key, each.shape) for key, each in arrays.items()))
        what = "several arrays may be ranges" if wide else "no array may be ranges, a scan a row"
        raise InputError(f"{source}: {what} ({found}). Save the ranges in a file of their own.")
    name, ranges = next(iter(wide.items()))
    n, width = ranges.shape
    others = {key: values for key, values in arrays.items() if key != name}
    vectors = {key: values.ravel() for key, values in others.items() if min(values.shape) == 1}
    vectors |= {key: values[0] for key, values in others.items() if values.shape == ranges.shape}
    angles = [key for key, values in vectors.items() if len(values) in (n, width) and _are_directions(key, values)]
    lengths = {max(values.shape) for key, values in others.items() if key not in angles}
    are_columns = len(vectors[angles[0]]) == n if angles else width in lengths and n not in lengths
    if are_columns and n != width:
        ranges, n, width = ranges.T, width, n
    words = f"ranges are {name}"
    direction = vectors[angles[0]] if angles else None
    if direction is not None:
        in_degrees = float(np.abs(direction).max()) > 2.0 * np.pi + 0.1
        direction = np.radians(direction) if in_degrees else direction
        words += f", directions {angles[0]} in {'degrees' if in_degrees else 'radians'}"
    return _plain(ranges)._replace(direction=direction, words=words)


def _are_directions(name: str, values: FloatArray) -> bool:
    """Return whether a vector is the directions of beams, evenly spaced, in radians or degrees."""
    step = np.diff(values)
    is_even = len(step) >= FEWEST - 1 and bool((np.abs(step - step.mean()) < 0.1 * abs(step.mean())).all())
    is_named_so = re.search(r"ang|theta|bear|phi|dir", name, re.IGNORECASE) is not None
    return is_even and is_named_so and not ODOMETRY.search(name)


def _fields(line: bytes) -> list[bytes]:
    return [field for field in re.split(rb"[\s,;]+", line) if field]


def _are_numbers(fields: list[bytes]) -> bool:
    try:
        np.array(fields, np.float64)
    except ValueError:
        return False
    return True
