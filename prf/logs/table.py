"""Tables: CSV with a header, one beam a row, the project's own plain format.

Columns ``x,y,theta,range`` are needed, in any order: position of the sensor and direction of the beam in the world,
metres and radians counter-clockwise. Optional are ``cone`` (full angle in radians, 0 if absent), ``t`` (seconds) and
``scan`` (a number from 0). An empty range or ``inf`` is no return; a range of exactly 0 is an error code of the sensor,
dropped and counted. Without ``scan`` consecutive rows with the same position and time make one scan. Blank lines and
lines that begin with ``#`` are passed over; further columns are left alone.
"""

from __future__ import annotations

import os

import numpy as np

from prf.logs.columns import PLACE, Domain, Rows, column_names, content_lines, read_header, read_rows, refuse_value
from prf.logs.numbers import LARGEST_TIME
from prf.logs.readings import FloatArray, IntArray, Kind, LogNotes, Readings, ScanTable, beam_numbers
from prf.logs.rings import CONE
from prf.shell.errors import InputError
from prf.shell.files import open_output
from prf.window import LARGEST_COORDINATE

REQUIRED = ("x", "y", "theta", "range")
OPTIONAL = ("cone", "t", "scan")

HEADER = "Name the columns x,y,theta,range (and cone,t,scan if there are any)."
POINT_HEADER = "Point observations (x,y,value) are given as --point-data."

EMPTY = {"range": b"inf", "t": b"nan"}


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
    lines = content_lines(data)
    first_line, first = next(lines)
    advice = POINT_HEADER if "value" in column_names(first) else HEADER
    header = read_header(first, f"{source}:{first_line}", REQUIRED, OPTIONAL, advice)
    rows = read_rows(lines, header, source, EMPTY)
    if not len(rows.line):
        raise InputError(f"{source}: table without a row below its header. Give at least one beam.")
    _check(rows)
    if kind == "sonar" and "cone" not in rows.columns:
        rows.columns["cone"] = np.full(len(rows.line), cone)
    readings = _assemble(rows, extra=header.width - len(header.places))
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


_DOMAINS = {
    "x": PLACE,
    "y": PLACE,
    "theta": Domain("radians, finite", -LARGEST_COORDINATE, LARGEST_COORDINATE),
    "range": Domain("a distance of at least 0, or empty or inf for no return", 0.0, np.inf),
    "cone": Domain("an angle from 0 to 2 pi", 0.0, 2 * np.pi),
    "t": Domain("seconds, finite, or empty", -LARGEST_TIME, LARGEST_TIME),
    "scan": Domain("a whole number from 0", 0.0, 2.0**53 - 1),
}


def _check(rows: Rows) -> None:
    """Refuse the first value outside its column's domain."""
    for name, values in rows.columns.items():
        domain = _DOMAINS[name]
        good = domain.holds(values)
        if name == "t":
            good |= np.isnan(values)
        if name == "scan":
            good &= values == np.floor(values)
        refuse_value(rows, name, good, domain.words)


def _assemble(rows: Rows, extra: int) -> Readings:
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
    ).where(usable)


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
