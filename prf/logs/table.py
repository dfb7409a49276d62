"""Tables of readings: CSV with a header, one beam a row, the project's own plain format.

Columns ``x,y,theta,range`` are needed, in any order: position of the sensor and direction of the beam in the world,
metres and radians counter-clockwise. Optional are ``cone`` (full angle in radians, 0 if absent), ``t`` (seconds) and
``scan`` (a number from 0). An empty range or ``inf`` is no return; a range of exactly 0 is an error code of the sensor,
dropped and counted. Without ``scan`` consecutive rows with the same position and time make one scan. Blank lines,
lines that begin with ``#`` and further columns are skipped.
"""

from __future__ import annotations

import os

import numpy as np

from prf.logs.poses import CONE
from prf.logs.readings import Kind, LogNotes, Readings, ScanTable, beam_numbers
from prf.logs.text import MEND, FloatArray, IntArray, Rows, column_names, content_lines, read_rows
from prf.shell.errors import InputError
from prf.shell.files import open_output

REQUIRED = ("x", "y", "theta", "range")
OPTIONAL = ("cone", "t", "scan")
HEADER = "Name the columns x,y,theta,range (and cone,t,scan if there are any)."
POINT_HEADER = "Point observations (x,y,value) are given as --point-data."


def read_table(data: bytes, source: str, kind: Kind | None = None, cone: float = CONE) -> Readings:
    """Read a table of beams, decompressed; `cone` (radians) is for a sonar's table without such a column.

    `kind` chooses between rows with and without a cone (or 0); a table with rows of one sort only is taken as it is.
    """
    _, first = next(content_lines(data), (0, b""))
    advice = POINT_HEADER if "value" in column_names(first) else HEADER
    rows = read_rows(data, source, REQUIRED, OPTIONAL, {"range": np.inf, "t": np.nan}, advice)
    if kind == "sonar" and "cone" not in rows.columns:
        rows.columns["cone"] = np.full(len(rows.line), cone)
    readings = _assemble(rows, source)
    is_sonar = readings.cone > 0
    if kind is None or is_sonar.all() or not is_sonar.any():
        return readings
    return readings.select(is_sonar if kind == "sonar" else ~is_sonar)


def write_table(path: str | os.PathLike[str], readings: Readings) -> None:
    """Write readings as a table that `read_table` gives back exactly, beam numbers and notes apart; ``-`` is stdout."""
    columns = (*readings.origin.T, readings.angle, readings.range, readings.cone, readings.time, readings.scan)
    with open_output(path) as stream:
        stream.write(",".join((*REQUIRED, *OPTIONAL)) + "\n")
        for row in zip(*(column.tolist() for column in columns), strict=True):
            stream.write(",".join("" if value != value else repr(value) for value in row) + "\n")


def _assemble(rows: Rows, source: str) -> Readings:
    columns = rows.columns
    origin = np.column_stack((columns["x"], columns["y"]))
    time = columns.get("t", np.full(len(origin), np.nan))
    scan = _whole(columns["scan"], rows, source) if "scan" in columns else _scans_by_place(origin, time)
    usable = columns["range"] > 0
    if not usable.any():
        raise InputError(f"{source}: every range is 0, which means no measurement. Give readings with a distance.")
    notes = LogNotes(
        format="table",
        scans=_scan_table(scan, rows.line, origin, time),
        devices=("table",),
        n_zero_ranges=int(np.count_nonzero(~usable)),
        lines={"further columns": rows.n_unknown} if rows.n_unknown else {},
    )
    return Readings.from_arrays(
        origin,
        columns["theta"],
        columns["range"],
        scan=scan,
        beam=beam_numbers(scan),
        time=time,
        cone=columns.get("cone", 0.0),
        source=source,
        notes=notes,
    ).where(usable)


def _whole(scan: FloatArray, rows: Rows, source: str) -> IntArray:
    """Return scan numbers as integers."""
    odd = np.flatnonzero(scan % 1)
    if len(odd):
        raise InputError(f"{source}:{rows.line[odd[0]]}: scan is {scan[odd[0]]:g}, but must be a whole number. {MEND}")
    return scan.astype(np.int64)


def _scans_by_place(origin: FloatArray, time: FloatArray) -> IntArray:
    """Return scan numbers that grow by one wherever position or time changes from one row to the next."""
    key = np.column_stack((origin, np.nan_to_num(time, nan=-1.0)))
    return np.concatenate(([0], np.cumsum(np.any(key[1:] != key[:-1], axis=1)))).astype(np.int64)


def _scan_table(scan: IntArray, line: IntArray, origin: FloatArray, time: FloatArray) -> ScanTable:
    number, first, counts = np.unique(scan, return_index=True, return_counts=True)
    pose = np.column_stack((origin[first], np.full(len(first), np.nan)))
    device = np.zeros(len(first), dtype=np.int64)
    return ScanTable(number, line[first], counts.astype(np.int64), device, pose, time[first])
