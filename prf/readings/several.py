"""Several logs of one kind of sensor, joined to one: each keeps its scans and devices."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from prf.readings.describe import default_max_range
from prf.readings.readings import LogNotes, Readings, ScanTable
from prf.readings.text import FloatArray

logger = logging.getLogger(__name__)

MEETS = 0.3
"""Metres between returns of two logs up to which they may be of one wall."""
FEW_MEET = 0.5
"""Share of the returns of a log in ground that another one saw, of which fewer meet that one's: hardly one frame."""
FEWEST = 200
"""Returns in common ground by which two logs are compared."""
MOST_COMPARED = 20_000
GROUND = 1.0
"""Metres round the returns of a log that count as ground it saw."""


def join_logs(logs: Sequence[Readings]) -> Readings:
    """Return the readings of all logs of a kind, at least one, in one frame.

    Scans are numbered on from log to log, and every log's devices are its own. ``Readings.log`` says of which one a
    reading is.
    """
    if len(logs) == 1:
        return logs[0]
    lengths = tuple(length for log in logs for length in log.lengths)
    first = np.cumsum([0, *(sum(log.lengths) for log in logs[:-1])])
    number = np.cumsum([0, *(1 + int(log.log.max(initial=-1)) for log in logs[:-1])])
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(log, name) for log in logs])
        for name in ("origin", "angle", "range", "beam", "time", "cone", "weight", "share")
    }
    return Readings(
        **arrays,
        scan=np.concatenate([log.scan + start for log, start in zip(logs, first.tolist(), strict=True)]),
        log=np.concatenate([log.log + start for log, start in zip(logs, number.tolist(), strict=True)]),
        source=" and ".join(log.source for log in logs),
        max_range=logs[0].max_range if len({log.max_range for log in logs}) == 1 else np.inf,
        notes=_joined_notes(logs, first.tolist(), lengths),
    )


def _joined_notes(logs: Sequence[Readings], first: Sequence[int], lengths: tuple[int, ...]) -> LogNotes:
    """Return the notes of logs joined whose scans begin at `first`."""
    notes = [log.notes for log in logs]
    tops = [each.sensor_max for each in notes if each.sensor_max == each.sensor_max]
    devices = np.cumsum([0, *(len(each.devices) for each in notes)]).tolist()
    tables = [
        each.scans._replace(number=each.scans.number + start, device=each.scans.device + device)
        for each, start, device in zip(notes, first, devices[:-1], strict=True)
    ]
    columns = {name: np.concatenate([getattr(table, name) for table in tables]) for name in ScanTable._fields[:-1]}
    driven = [table.pose if table.odometry is None else table.odometry for table in tables]
    return replace(
        notes[0],
        format=", ".join(dict.fromkeys(each.format for each in notes)),
        scans=ScanTable(**columns, odometry=np.concatenate(driven)),
        devices=tuple(device for each in notes for device in each.devices),
        sensor_max=max(tops, default=np.nan),
        lengths=lengths,
        names=tuple(name for log in logs for name in log.names),
    )


def warn_of_frames(logs: Sequence[Readings]) -> None:
    """Log a warning of each log that hardly agrees with those before it on walls that both saw."""
    if len(logs) < 2:
        return
    from scipy.spatial import cKDTree  # noqa: PLC0415 - a fifth of a second, for several logs alone

    ends = [_some_returns(log.within(default_max_range(log))) for log in logs]
    for i in range(1, len(logs)):
        tree = cKDTree(np.concatenate(ends[:i]))
        distance, _ = tree.query(ends[i])
        common = distance < GROUND
        if common.sum() >= FEWEST and np.mean(distance[common] < MEETS) < FEW_MEET:
            logger.warning(
                f"{logs[i].source}: of its returns within {GROUND:g} m of walls of the logs before it, only "
                f"{np.mean(distance[common] < MEETS):.0%} meet them within {MEETS:g} m: are all in one frame? Give the "
                "poses of each with --poses."
            )


def _some_returns(readings: Readings) -> FloatArray:
    """Return the ends (n, 2) of some beams with a return, metres."""
    ends = readings.impacts()
    return ends[:: 1 + len(ends) // MOST_COMPARED]
