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

from prf.model.sensors import CONE
from prf.readings.readings import Kind, LogNotes, Readings, ScanTable, beam_numbers
from prf.readings.text import MEND, FloatArray, IntArray, Rows, column_names, content_lines, read_rows
from prf.shell.cli.files import open_output
from prf.shell.errors import InputError

REQUIRED = ("x", "y", "theta", "range")
OPTIONAL = ("cone", "t", "scan")
HEADER = "Name the columns x,y,theta,range (and cone,t,scan if there are any)."
POINT_HEADER = "Point observations (x,y,value) are given as --point-data."


def read_table(
    data: bytes, source: str, kind: Kind | None = None, cone: float = CONE, on_robot: bool = False
) -> Readings:
    """Read a table of beams, decompressed; `cone` (radians) is for a sonar's table without such a column.

    `kind` chooses between rows with and without a cone (or 0); a table with rows of one sort only is taken as it is.
    `on_robot`: see ``poses.py``; then x and y, the place of the sensor on the robot, may be missing, and theta
    is the direction on the robot.
    """
    _, first = next(content_lines(data), (0, b""))
    advice = POINT_HEADER if "value" in column_names(first) else HEADER
    needed, further = (REQUIRED[2:], (*REQUIRED[:2], *OPTIONAL)) if on_robot else (REQUIRED, OPTIONAL)
    rows = read_rows(data, source, needed, further, {"range": np.inf, "t": np.nan}, advice)
    if on_robot:
        _check_on_robot(rows, source)
    if kind == "sonar" and "cone" not in rows.columns:
        rows.columns["cone"] = np.full(len(rows.line), cone)
    readings = _assemble(rows, source, on_robot)
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


def _check_on_robot(rows: Rows, source: str) -> None:
    """Give rows without a place on the robot one; refuse poses in the world, and scans that cannot be distinguished."""
    for name in REQUIRED[:2]:
        place = rows.columns.setdefault(name, np.zeros(len(rows.line)))
        if (place != place[0]).any():
            raise InputError(
                f"{source}: with --poses, x and y must be the constant position of the sensor on the robot, but {name} "
                "changes. Leave columns x and y out, with theta as the direction of the beam on the robot."
            )
    if not {"t", "scan"} & rows.columns.keys():
        raise InputError(f"{source}: --poses gives one pose to each scan. Add a column t (seconds) or scan (from 0).")


def _assemble(rows: Rows, source: str, on_robot: bool) -> Readings:
    columns = rows.columns
    origin = np.column_stack((columns["x"], columns["y"]))
    time = columns.get("t", np.full(len(origin), np.nan))
    scan = _whole(columns["scan"], rows, source) if "scan" in columns else _scans_by_place(origin, time)
    usable = columns["range"] > 0
    if not usable.any():
        raise InputError(f"{source}: every range is 0, which means no measurement. Give readings with a distance.")
    notes = LogNotes(
        format="table",
        poses="the robot" if on_robot else "in the log",
        scans=_scan_table(scan, rows.line, origin, time, None if on_robot else columns["theta"]),
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


def _scan_table(
    scan: IntArray, line: IntArray, origin: FloatArray, time: FloatArray, direction: FloatArray | None
) -> ScanTable:
    """Return the scans; their heading is the direction of the beam in the middle of each, None: ahead."""
    order = np.argsort(scan, kind="stable")
    number, start, counts = np.unique(scan[order], return_index=True, return_counts=True)
    first = order[start]
    heading = np.zeros(len(first)) if direction is None else direction[order[start + counts // 2]]
    pose = np.column_stack((origin[first], heading))
    device = np.zeros(len(first), dtype=np.int64)
    return ScanTable(number, line[first], counts.astype(np.int64), device, pose, time[first])
