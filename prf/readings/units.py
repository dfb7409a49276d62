"""In which unit ranges are whose file does not say: metres, centimetres or millimetres, as scans agree at poses.

What scanners see leaves two units at most. In the wrong one the robot drives ten times too far between two scans, or
ten times too little, and these do not lie on each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from prf.readings.readings import Readings
from prf.readings.text import FloatArray, IntArray

METRES = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001}
"""Metres in each unit."""
SHORTEST, FARTHEST = 0.1, 100.0
"""Metres that the median range of a log lies between; of the logs at hand 1.8 to 12.8."""
REACH = 0.97
"""Of the largest range: from there on numbers stand for no return."""
APART = (0.2, 1.0)
"""Of the median range, in the smaller unit: how far apart scans are that are compared."""
CELL = 0.05
"""Of the median range: scans agree where their returns lie in the same squares of this side."""
MOST_PAIRS = 100
SURE = 2.0
"""Standard deviations of chance by which more pairs agree better in one unit than in the other."""
AGREE = 0.2
"""Share of the squares of a scan that the other has too, in the mean of all pairs: .26 to .65 in the right unit, and at
most .18 in one that wins by errors of the poses (30 cm, 2 degrees)."""


class Unit(NamedTuple):
    """The unit of ranges, and in words how it is known."""

    name: str
    why: str

    @property
    def metres(self) -> float:
        """Metres in one."""
        return METRES[self.name]


def unit_of(
    ranges: FloatArray, poses: FloatArray | None, directions: Callable[[FloatArray], FloatArray]
) -> Unit | None:
    """Return the unit of ranges (n, w), nan where there is none; None where it does not show.

    `poses` (n, 3): of the scans, metres and radians. `directions` returns where beams (w,) point on the sensor,
    radians, if ranges (n, w) in metres are these.
    """
    returns = _returns(ranges)
    if not np.isfinite(returns).any():
        return None
    usual = float(np.nanmedian(returns))
    fitting = [name for name, metres in METRES.items() if SHORTEST < usual * metres <= FARTHEST]
    if len(fitting) < 2:
        return Unit(fitting[0], f"since half of them are above {usual:,.0f}") if fitting else None
    pairs = [] if poses is None else _pairs(poses, usual * METRES[fitting[1]])
    if poses is None or not pairs:
        return None
    agreed = []
    for name in fitting:
        beams, side = directions(ranges * METRES[name]), CELL * usual * METRES[name]
        ends = _Ends(returns * METRES[name], beams, poses, side)
        agreed.append(np.array([ends.agreement(*pair) for pair in pairs]))
    lead = float(np.sign(agreed[0] - agreed[1]).sum()) / math.sqrt(len(pairs))
    best = 0 if lead > 0.0 else 1
    is_sure = abs(lead) >= SURE and float(agreed[best].mean()) >= AGREE
    return Unit(fitting[best], "in which scans agree at their poses") if is_sure else None


def in_metres(readings: Readings) -> Readings:
    """Return readings of a laser, at poses, whose file does not say the unit of ranges; as they are if it is not sure.

    The directions of the beams are the same in all scans.
    """
    if not readings.n_beams:
        return readings
    scans = readings.notes.scans
    row = np.searchsorted(scans.number, readings.scan)
    width = int(readings.beam.max()) + 1
    ranges, beams = np.full((len(scans.number), width), np.nan), np.zeros(width)
    ranges[row, readings.beam] = readings.range
    beams[readings.beam] = readings.angle - scans.pose[row, 2]
    unit = unit_of(ranges, scans.pose, lambda _: beams)
    if unit is None or unit.metres == 1.0:
        return readings
    notes = replace(readings.notes, range_unit=f"in {unit.name}, {unit.why}")
    return replace(readings, range=readings.range * unit.metres, notes=notes)


def _returns(ranges: FloatArray) -> FloatArray:
    """Return ranges, nan where there is no return."""
    finite = np.where(np.isfinite(ranges) & (ranges > 0.0), ranges, np.nan)
    largest = float(np.max(finite, initial=0.0, where=np.isfinite(finite)))
    most = np.where(finite < REACH * largest, finite, np.nan)
    return most if np.isfinite(most).any() else finite


def _pairs(poses: FloatArray, usual: float) -> list[tuple[int, int]]:
    """Return some scans, each with the next one that is neither too near to it nor too far."""
    low, high = APART[0] * usual, APART[1] * usual
    pairs = []
    for i in range(0, len(poses) - 1, 1 + len(poses) // MOST_PAIRS):
        step = poses[i + 1 :, :2] - poses[i, :2]
        length = np.hypot(step[:, 0], step[:, 1])
        j = int(np.argmax(length >= low))
        if low <= length[j] <= high:
            pairs.append((i, i + 1 + j))
    return pairs


class _Ends(NamedTuple):
    """Returns (n, w), metres, the directions (w,) of beams, poses (n, 3), and the side of squares, metres."""

    ranges: FloatArray
    beams: FloatArray
    poses: FloatArray
    side: float

    def agreement(self, i: int, j: int) -> float:
        """Return the share of the squares with returns of one scan that the other has too."""
        both = self._squares(i), self._squares(j)
        least = min(map(len, both))
        return len(np.intersect1d(*both, assume_unique=True)) / least if least else 0.0

    def _squares(self, scan: int) -> IntArray:
        hit = np.isfinite(self.ranges[scan])
        end = self.ranges[scan, hit] * np.exp(1j * (self.beams[hit] + self.poses[scan, 2]))
        x, y = (end.real + self.poses[scan, 0]) / self.side, (end.imag + self.poses[scan, 1]) / self.side
        return np.unique(np.floor(x).astype(np.int64) * (1 << 32) + np.floor(y).astype(np.int64))
