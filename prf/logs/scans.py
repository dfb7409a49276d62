"""From scans, as the lines or messages of a log give them, to `Readings`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from prf.logs.readings import FloatArray, LogNotes, Readings, ScanTable
from prf.shell.errors import InputError


class Scan(NamedTuple):
    """The beams of one line or message.

    Attributes
    ----------
    device : str
        Name of the sensor.
    line : int
        As `ScanTable.line`.
    time : float
        Seconds.
    pose : (3,) float64
        As `ScanTable.pose`.
    origin : (2,) or (n, 2) float64
        Where the beams begin, metres.
    angle : (n,) float64
        Their directions in the world, radians.
    range : (n,) float64
        Metres; inf: no return, 0 or nan: no measurement.
    cone : float
        Full opening angle, radians.
    """

    device: str
    line: int
    time: float
    pose: FloatArray
    origin: FloatArray
    angle: FloatArray
    range: FloatArray
    cone: float = 0.0


def assemble(scans: Sequence[Scan], source: str, notes: LogNotes) -> Readings:
    """Return the usable beams of all scans, which are numbered from 0 in their order.

    Parameters
    ----------
    scans : sequence of Scan
        At least one.
    source : str
        Name of the log, for messages.
    notes : LogNotes
        What the reader noticed; scans, devices and counts of dropped beams are filled in here.

    Raises
    ------
    InputError
        If no beam is usable.
    """
    table = _scan_table(scans)
    ranges = np.concatenate([scan.range for scan in scans])
    usable = ranges > 0
    n_zero, n_invalid = int(np.count_nonzero(ranges == 0)), int(np.count_nonzero(np.isnan(ranges)))
    if not usable.any():
        why = "no number or too short" if n_invalid else "0"
        raise InputError(f"{source}: every range is {why}, which means no measurement. Look for a log with readings.")
    devices = tuple(dict.fromkeys(scan.device for scan in scans))
    return Readings.from_arrays(
        np.concatenate([np.broadcast_to(scan.origin, (len(scan.range), 2)) for scan in scans]),
        np.concatenate([scan.angle for scan in scans]),
        ranges,
        scan=np.repeat(table.number, table.n_beams),
        time=np.repeat(table.time, table.n_beams),
        cone=np.repeat([scan.cone for scan in scans], table.n_beams),
        source=source,
        notes=replace(notes, scans=table, devices=devices, n_zero_ranges=n_zero, n_invalid=n_invalid),
    ).where(usable)


def _scan_table(scans: Sequence[Scan]) -> ScanTable:
    devices = list(dict.fromkeys(scan.device for scan in scans))
    return ScanTable(
        number=np.arange(len(scans)),
        line=np.array([scan.line for scan in scans], dtype=np.int64),
        n_beams=np.array([len(scan.range) for scan in scans], dtype=np.int64),
        device=np.array([devices.index(scan.device) for scan in scans], dtype=np.int64),
        pose=np.array([scan.pose for scan in scans]),
        time=np.array([scan.time for scan in scans]),
    )
