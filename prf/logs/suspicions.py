"""Signs that a log is not what it seems: jumps, clocks that do not run, ranges that no scanner has.

Whether the poses agree with one another over loops cannot be told cheaply, so nothing here says that a log is good.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.logs.readings import FloatArray, Readings, ScanTable

STEP = 1.0
"""Metres; a shorter step is never called a jump."""
TURN = 1.0
"""Radians; likewise. Corrected logs turn up to 1.4 rad between scans that are seconds apart."""
SPEED = 3.0
"""Metres a second, and radians a second: beyond what indoor robots do."""
FAR_STEP = 5.0
"""Times the median step: the corrected logs at hand reach 3.4, with scans a metre apart."""
FAR_TURN = 1.5
"""Radians between scans whose time distance is unknown."""
STILL = 20
"""Scans in a row at one and the same pose that are worth a remark."""
LARGEST_SANE_RANGE = 1000.0
"""Metres. Some drivers write the largest float for "no return", which makes a default maximum range of no use."""
LARGEST_USUAL_RANGE = 100.0
"""Metres. Half of the returns beyond it are a log in millimetres or centimetres."""
LARGEST_SANE_ANGLE = 4 * np.pi
"""Radians. Beyond it headings are counted over turns at best, in degrees at worst."""
DAY = 86400.0


class Suspicion(NamedTuple):
    """Something to look at.

    Attributes
    ----------
    code : str
        One word for scripts.
    message : str
        One sentence for a person.
    scans : tuple of int
        Scan numbers that it concerns, all of them; empty if it concerns the log.
    """

    code: str
    message: str
    scans: tuple[int, ...] = ()


class _Steps(NamedTuple):
    """Steps between successive scans of one device; row i leads to scan `number[i]`."""

    number: NDArray[np.int64]
    distance: FloatArray
    turn: FloatArray
    seconds: FloatArray


def find_suspicions(readings: Readings) -> tuple[Suspicion, ...]:
    """Return what looks suspicious in a log, the whole of it.

    Parameters
    ----------
    readings : Readings
        As `read_readings` gives it; poses and times are those of ``readings.notes.scans``.
    """
    scans = readings.notes.scans
    return (
        *_jumps(scans),
        *_standing(scans),
        *_clock(scans),
        *_beam_counts(scans),
        *_ranges(readings),
        *_angles(readings),
        *_odd_lines(readings),
    )


def _steps(scans: ScanTable, device: int) -> _Steps:
    rows = np.flatnonzero(scans.device == device)
    change = np.diff(scans.pose[rows], axis=0)
    turn = np.abs(np.angle(np.exp(1j * change[:, 2])))
    return _Steps(scans.number[rows[1:]], np.hypot(change[:, 0], change[:, 1]), turn, np.diff(scans.time[rows]))


def _is_jump(steps: _Steps) -> NDArray[np.bool_]:
    moving = steps.distance[steps.distance > 0.01]
    usual = float(np.median(moving)) if len(moving) else 0.0
    timed = steps.seconds > 0
    seconds = np.where(timed, steps.seconds, np.inf)
    fast = (steps.distance > np.maximum(STEP, SPEED * seconds)) | (steps.turn > np.maximum(TURN, SPEED * seconds))
    far = steps.distance > max(STEP, FAR_STEP * usual)
    turned = ~timed & (steps.turn > FAR_TURN)
    return fast | far | turned


def _jumps(scans: ScanTable) -> Iterator[Suspicion]:
    for device in np.unique(scans.device):
        steps = _steps(scans, int(device))
        jump = _is_jump(steps)
        if jump.any():
            numbers = tuple(int(n) for n in steps.number[jump])
            worst = int(np.argmax(np.where(jump, steps.distance, -1.0)))
            far = f"the largest by {steps.distance[worst]:.1f} m at scan {steps.number[worst]}"
            yield Suspicion("pose-jump", f"the pose jumps before {_list(numbers, 'scan')}, {far}", numbers)


def _standing(scans: ScanTable) -> Iterator[Suspicion]:
    for device in np.unique(scans.device):
        steps = _steps(scans, int(device))
        moved = ~((steps.distance == 0) & ~(steps.turn > 0))
        ends = np.flatnonzero(np.r_[True, moved, True])
        lengths = np.diff(ends)
        long = np.flatnonzero(lengths >= STILL)
        if len(long):
            rows = scans.number[scans.device == device]
            first = tuple(int(rows[ends[i]]) for i in long)
            text = (
                f"the pose is the same to the last digit for up to {lengths.max()} scans, from {_list(first, 'scan')}"
            )
            yield Suspicion("same-pose", text, first)


def _clock(scans: ScanTable) -> Iterator[Suspicion]:
    time = scans.time
    if np.isnan(time).all():
        return
    change = np.diff(time)
    back = tuple(int(n) for n in scans.number[1:][change < 0])
    tied = int(np.count_nonzero((change == 0) & (np.diff(scans.device) == 0)))
    if back:
        yield Suspicion("time-backward", f"the clock runs backward before {_list(back, 'scan')}", back)
    if tied:
        yield Suspicion("time-tied", f"{tied} of {len(change)} scans have the time stamp of the scan before")
    if np.nanmax(time) - np.nanmin(time) > DAY:
        days = (np.nanmax(time) - np.nanmin(time)) / DAY
        yield Suspicion("time-span", f"the time stamps span {days:,.1f} days")


def _beam_counts(scans: ScanTable) -> Iterator[Suspicion]:
    for device in np.unique(scans.device):
        rows = scans.device == device
        counts, first, times = np.unique(scans.n_beams[rows], return_index=True, return_counts=True)
        if len(counts) > 1:
            rare = np.argsort(times, kind="stable")[:-1]
            numbers = tuple(sorted(int(scans.number[rows][first[i]]) for i in rare))
            usual = counts[int(np.argmax(times))]
            text = f"{len(counts)} different beam counts, mostly {usual}; others first at {_list(numbers, 'scan')}"
            yield Suspicion("beam-count", text, numbers)


def _ranges(readings: Readings) -> Iterator[Suspicion]:
    zero, largest = readings.notes.n_zero_ranges, readings.largest_range
    if zero:
        share = zero / (zero + readings.notes.n_invalid + readings.n_beams)
        yield Suspicion("zero-range", f"{zero} beams ({share:.2%}) have range 0, an error code: dropped")
    if np.isnan(largest):
        yield Suspicion("no-return", "no beam has a finite range: there is no maximum range to take from this log")
    elif largest > LARGEST_SANE_RANGE:
        yield Suspicion("largest-range", f"the largest range is {largest:g} m: give the maximum range yourself")
    if readings.notes.n_invalid:
        share = readings.notes.n_invalid / (readings.notes.n_invalid + zero + readings.n_beams)
        text = f"{readings.notes.n_invalid} beams ({share:.2%}) have a range that is no number or too short: dropped"
        yield Suspicion("invalid-range", text)
    finite = readings.range[np.isfinite(readings.range)]
    usual = float(np.quantile(finite, 0.5, method="lower")) if len(finite) else 0.0
    if usual > LARGEST_USUAL_RANGE:
        yield Suspicion("range-unit", f"half of the ranges are above {usual:g} m: are they in millimetres?")


def _angles(readings: Readings) -> Iterator[Suspicion]:
    largest = float(np.abs(readings.angle).max())
    if largest > LARGEST_SANE_ANGLE:
        yield Suspicion("angle", f"directions reach {largest:g} rad: are they in degrees?")


def _odd_lines(readings: Readings) -> Iterator[Suspicion]:
    odd = readings.notes.odd_lines
    if odd:
        kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(odd.items(), key=lambda item: -item[1])[:5])
        yield Suspicion("odd-line", f"lines of unknown kinds were passed over: {kinds}")


def _list(numbers: tuple[int, ...], word: str, most: int = 8) -> str:
    """Return ``scan 5`` or ``scans 5, 8, ... (12 in all)``."""
    shown = ", ".join(map(str, numbers[:most]))
    if len(numbers) == 1:
        return f"{word} {shown}"
    return f"{word}s {shown}" + (f" ... ({len(numbers)} in all)" if len(numbers) > most else "")
