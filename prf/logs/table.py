"""Tables: CSV with a header, one beam a row, the project's own plain format.

Columns ``x,y,theta,range`` are needed, in any order: position of the sensor and direction of the beam in the world,
metres and radians counter-clockwise. Optional are ``cone`` (full angle in radians, 0 if absent), ``t`` (seconds) and
``scan`` (a number from 0). An empty range or ``inf`` is no return; a range of exactly 0 is an error code of the sensor,
dropped and counted. Without ``scan`` consecutive rows with the same position and time make one scan. Blank lines and
lines that begin with ``#`` are passed over; further columns are left alone.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from prf.logs.numbers import LARGEST_COORDINATE, LARGEST_TIME, MEND, is_number, show
from prf.logs.readings import FloatArray, IntArray, Kind, LogNotes, Readings, ScanTable, beam_numbers
from prf.logs.rings import CONE
from prf.shell.errors import InputError
from prf.shell.files import open_output

REQUIRED = ("x", "y", "theta", "range")
OPTIONAL = ("cone", "t", "scan")

BLOCK = 65536
"""Rows parsed at a time, so that the text fields of a long table are never all in memory."""


class _Rows(NamedTuple):
    """The rows under the header, as text: fields of column j are ``fields[j]``; `line` numbers them in the file."""

    source: str
    line: IntArray
    columns: dict[str, FloatArray]


def read_table(data: bytes, source: str, kind: Kind | None = None, cone: float = CONE) -> Readings:
    """Read a table of beams.

    Parameters
    ----------
    data : bytes
        The text of the table, decompressed.
    source : str
        Name of the table, for messages.
    kind : {"laser", "sonar"} or None
        Which rows to take if some have a cone and some have none (or 0); with rows of one sort only, all.
    cone : float
        Cone in radians of a sonar's table without such a column.

    Returns
    -------
    Readings
        Every row whose range is not 0; inf where there is no return.

    Raises
    ------
    InputError
        For a missing or doubled column, a row of the wrong length, and a value outside its domain.
    """
    lines = [(number, line) for number, line in enumerate(data.splitlines(), 1) if _counts(line)]
    header_line, header = lines[0]
    places = _places(header, f"{source}:{header_line}")
    if len(lines) == 1:
        raise InputError(f"{source}: table without a row below its header. Give at least one beam.")
    rows = _parse(lines[1:], places, header.count(b",") + 1, source)
    _check(rows)
    if kind == "sonar" and "cone" not in places:
        rows.columns["cone"] = np.full(len(rows.line), cone)
    readings = _assemble(rows, extra=header.count(b",") + 1 - len(places))
    return readings if kind is None else _only(readings, kind)


def _only(readings: Readings, kind: Kind) -> Readings:
    """Return the rows of one kind of sensor, if there are two."""
    is_sonar = readings.cone > 0
    if is_sonar.all() or not is_sonar.any():
        return readings
    return readings.select(is_sonar if kind == "sonar" else ~is_sonar)


def write_table(path: str | os.PathLike[str], readings: Readings) -> None:
    """Write readings as a table that `read_table` gives back exactly, beam numbers and notes apart.

    Parameters
    ----------
    path : path
        Where to; ``-`` is standard output.
    readings : Readings
        What to write; a time that is nan becomes an empty field.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    columns = (*readings.origin.T, readings.angle, readings.range, readings.cone, readings.time, readings.scan)
    with open_output(path) as stream:
        stream.write(",".join((*REQUIRED, *OPTIONAL)) + "\n")
        for row in zip(*(column.tolist() for column in columns), strict=True):
            stream.write(",".join("" if value != value else repr(value) for value in row) + "\n")


def column_names(line: bytes) -> list[str]:
    """Return the names in a header line, lower case, without blanks and quotes."""
    return [name.strip(" \t\"'").lower() for name in line.decode("utf-8", "replace").split(",")]


def _counts(line: bytes) -> bool:
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(b"#")


def _places(header: bytes, where: str) -> dict[str, int]:
    names = column_names(header)
    known = [name for name in names if name in REQUIRED + OPTIONAL]
    doubled = sorted({name for name in known if known.count(name) > 1})
    missing = [name for name in REQUIRED if name not in known]
    if missing or doubled:
        what = f"no column {', '.join(missing)}" if missing else f"column {', '.join(doubled)} twice"
        raise InputError(
            f"{where}: the header has {what}. Name the columns x,y,theta,range (and cone,t,scan if there are any)."
        )
    return {name: names.index(name) for name in known}


def _parse(lines: Sequence[tuple[int, bytes]], places: dict[str, int], width: int, source: str) -> _Rows:
    number = np.array([n for n, _ in lines], dtype=np.int64)
    commas = np.array([line.count(b",") for _, line in lines])
    wrong = np.flatnonzero(commas != width - 1)
    if len(wrong):
        has = commas[wrong[0]] + 1
        raise InputError(f"{source}:{number[wrong[0]]}: row of {has} fields under a header of {width}. {MEND}")
    parts: dict[str, list[FloatArray]] = {name: [] for name in places}
    for start in range(0, len(lines), BLOCK):
        fields = b",".join(line for _, line in lines[start : start + BLOCK]).split(b",")
        for name, place in places.items():
            parts[name].append(_column(fields[place::width], name, number[start:], source))
    return _Rows(source, number, {name: np.concatenate(blocks) for name, blocks in parts.items()})


EMPTY = {"range": b"inf", "t": b"nan"}
"""What an empty field stands for; in every other column it is an error."""


def _column(fields: list[bytes], name: str, number: IntArray, source: str) -> FloatArray:
    if name in EMPTY:
        fields = [text if text and not text.isspace() else EMPTY[name] for text in fields]
    try:
        values = np.array(fields, dtype=np.float64)
    except ValueError:
        values = None
    if values is None or b"_" in b"".join(fields):
        bad = next(i for i, text in enumerate(fields) if not is_number(text))
        raise InputError(f"{source}:{number[bad]}: {name} is {show(fields[bad].strip())}, not a number. {MEND}")
    return values


class _Domain(NamedTuple):
    """The values that a column may hold, and the words for them."""

    words: str
    low: float
    high: float


_DOMAINS = {
    "x": _Domain("metres, finite", -LARGEST_COORDINATE, LARGEST_COORDINATE),
    "y": _Domain("metres, finite", -LARGEST_COORDINATE, LARGEST_COORDINATE),
    "theta": _Domain("radians, finite", -LARGEST_COORDINATE, LARGEST_COORDINATE),
    "range": _Domain("a distance of at least 0, or empty or inf for no return", 0.0, np.inf),
    "cone": _Domain("an angle from 0 to 2 pi", 0.0, 2 * np.pi),
    "t": _Domain("seconds, finite, or empty", -LARGEST_TIME, LARGEST_TIME),
    "scan": _Domain("a whole number from 0", 0.0, 2.0**53 - 1),
}


def _check(rows: _Rows) -> None:
    """Refuse the first value outside its column's domain."""
    for name, values in rows.columns.items():
        domain = _DOMAINS[name]
        good = (values >= domain.low) & (values <= domain.high)
        if name == "t":
            good |= np.isnan(values)
        if name == "scan":
            good &= values == np.floor(values)
        bad = np.flatnonzero(~good)
        if len(bad):
            at = f"{rows.source}:{rows.line[bad[0]]}"
            raise InputError(f"{at}: {name} is {values[bad[0]]:g}, but must be {domain.words}. {MEND}")


def _assemble(rows: _Rows, extra: int) -> Readings:
    columns = rows.columns
    origin = np.column_stack((columns["x"], columns["y"]))
    time = columns.get("t", np.full(len(origin), np.nan))
    scan = columns["scan"].astype(np.int64) if "scan" in columns else _scans_by_place(origin, time)
    usable = columns["range"] > 0
    if not usable.any():
        raise InputError(f"{rows.source}: every range is 0, which means no measurement. Give readings with a distance.")
    notes = LogNotes(
        format="table",
        scans=_scan_table(scan, rows.line, origin, time),
        devices=("table",),
        n_zero_ranges=int(np.count_nonzero(~usable)),
        lines={"further columns": extra} if extra else {},
    )
    return Readings.from_arrays(
        origin,
        columns["theta"],
        columns["range"],
        scan=scan,
        beam=beam_numbers(scan),
        time=time,
        cone=columns.get("cone", 0.0),
        source=rows.source,
        notes=notes,
    ).select(usable)


def _scans_by_place(origin: FloatArray, time: FloatArray) -> IntArray:
    """Return scan numbers that grow by one wherever position or time changes from one row to the next."""
    key = np.column_stack((origin, np.nan_to_num(time, nan=-1.0)))
    scan = np.zeros(len(key), dtype=np.int64)
    np.cumsum(np.any(key[1:] != key[:-1], axis=1), out=scan[1:])
    return scan


def _scan_table(scan: IntArray, line: IntArray, origin: FloatArray, time: FloatArray) -> ScanTable:
    number, first, counts = np.unique(scan, return_index=True, return_counts=True)
    pose = np.column_stack((origin[first], np.full(len(first), np.nan)))
    device = np.zeros(len(first), dtype=np.int64)
    return ScanTable(number, line[first], counts.astype(np.int64), device, pose, time[first])
