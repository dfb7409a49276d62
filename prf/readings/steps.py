"""How the poses of scans follow one another: jumps, and poses that jitter about the way driven."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.readings.readings import ScanTable
from prf.readings.text import FloatArray

STEP = 1.0  # metres; a shorter step is never called a jump
TURN = 1.0  # radians; likewise. Corrected logs turn up to 1.4 rad between scans that are seconds apart
SPEED = 3.0  # metres a second, and radians a second: beyond what indoor robots do
FAR_STEP = 5.0  # times the median step: the corrected logs at hand reach 3.4, with scans a metre apart
FAST_STEP = 3.0  # times the median step, or turn, that one beyond such a speed is at least
FAR_APART = 0.2  # share of steps beyond what a robot does from which on they are the log's own
FAR_TURN = 1.5  # radians between scans whose time distance is unknown
STILL = 0.01  # metres; a shorter step is none
USUAL_STEP = 100.0  # metres. Half of the steps beyond it are a log in millimetres or centimetres
MEND_UNIT = "Save them in metres"
MOST_LISTED = 8  # scans that a sentence names

OFF_MIDDLE = math.sqrt(1.5) * math.sqrt(2.0 * math.log(2.0))
"""Median distance in the plane of a pose from the middle of its neighbours, if all err independently by 1 an axis."""
OFF_MIDDLE_TURN = math.sqrt(1.5) * 0.6745
"""The same of headings."""
FEWEST_JITTER = 30  # scans from which on jitter is looked for
JITTER = 0.3  # of the usual step: corrected logs at hand reach .11, the poses of a scan matcher that jitters .5
LEAST_JITTER = 0.05  # metres
WIDEST_STEP = 1.5  # metres between scans, beyond which turns of the way look like jitter
BEYOND_JITTER = 8.0  # standard deviations of a step by jitter alone that jumps are beyond


SAME_STEP, SAME_TURN = (0.2, 0.2), (0.1, 0.15)
"""Metres and share of the distance, radians and share of the turn, by which odometry that makes a step too differs."""


class Jitter(NamedTuple):
    """Standard deviations by which poses err independently of one another, as the way shows that they make."""

    metres: float
    radians: float
    usual_step: float  # metres, median of those that move

    @property
    def is_jitter(self) -> bool:
        """Whether it is so much that a robot cannot have driven so; turns of the way are a little of it too."""
        return self.metres > max(LEAST_JITTER, JITTER * self.usual_step) and self.usual_step < WIDEST_STEP


NO_JITTER = Jitter(0.0, 0.0, 0.0)


class _Steps(NamedTuple):
    """Steps between successive scans of one device; row i leads to scan `number[i]`."""

    number: NDArray[np.int64]
    distance: FloatArray
    turn: FloatArray
    seconds: FloatArray
    jitter: Jitter
    is_driven: NDArray[np.bool_]  # whether odometry, which is given by itself, makes the step too


def jitter_of(pose: FloatArray) -> Jitter:
    """Return how far successive poses (n, 3) lie from the middle of those before and after them; 0 of few."""
    if len(pose) < FEWEST_JITTER:
        return NO_JITTER
    step = np.diff(pose, axis=0)
    step[:, 2] = np.angle(np.exp(1j * step[:, 2]))
    length = np.hypot(step[:, 0], step[:, 1])
    moves = np.maximum(length[1:], length[:-1]) > STILL
    if np.count_nonzero(moves) < FEWEST_JITTER:
        return NO_JITTER
    off = 0.5 * (step[:-1] - step[1:])[moves]
    metres = float(np.median(np.hypot(off[:, 0], off[:, 1]))) / OFF_MIDDLE
    return Jitter(metres, float(np.median(np.abs(off[:, 2]))) / OFF_MIDDLE_TURN, _usual(length))


def devices_of(scans: ScanTable) -> Iterator[FloatArray]:
    """Yield the poses (n, 3) of the scans of each device."""
    return (scans.pose[scans.device == device] for device in np.unique(scans.device))


def jumps(scans: ScanTable) -> Iterator[tuple[str, str, tuple[int, ...]]]:
    """Yield code, message and scans of what is wrong with the steps of each device.

    What odometry beside the poses drove too is no jump.
    """
    for device in np.unique(scans.device):
        steps = _steps(scans, int(device))
        usual = _usual(steps.distance)
        moved, turned, share = _are_far(steps)
        if usual > USUAL_STEP:
            text = f"half of the steps from scan to scan are above {usual:g} m: are the positions in millimetres?"
            yield "pose-unit", f"{text} {MEND_UNIT}", ()
            continue
        if share > FAR_APART:
            median = math.degrees(float(np.median(steps.turn)))
            text = f"scans are far apart: half of the steps are above {usual:.1f} m, or turn by {median:.0f} degrees"
            yield "scans-apart", text, ()
        moved, turned = moved & ~steps.is_driven, turned & ~steps.is_driven
        if moved.any() or turned.any():
            numbers = tuple(int(n) for n in steps.number[moved | turned])
            sizes = ((steps.distance, moved, ".1f", "m"), (np.degrees(steps.turn), turned, ".0f", "degrees"))
            far = " and ".join(_largest(steps, *size) for size in sizes if size[1].any())
            yield "pose-jump", f"the pose jumps before {listed(numbers, 'scan')}, the largest {far}", numbers


def _steps(scans: ScanTable, device: int) -> _Steps:
    rows = np.flatnonzero(scans.device == device)
    change = np.diff(scans.pose[rows], axis=0)
    turn = np.abs(np.angle(np.exp(1j * change[:, 2])))
    distance, jitter = np.hypot(change[:, 0], change[:, 1]), jitter_of(scans.pose[rows])
    driven = np.zeros(len(turn), np.bool_)
    if scans.odometry is not None and not np.array_equal(scans.odometry[rows], scans.pose[rows]):
        off = _motions(scans.pose[rows]) - _motions(scans.odometry[rows])
        apart, turned = np.hypot(off[:, 0], off[:, 1]), np.abs(np.angle(np.exp(1j * off[:, 2])))
        driven = (apart <= SAME_STEP[0] + SAME_STEP[1] * distance) & (turned <= SAME_TURN[0] + SAME_TURN[1] * turn)
    return _Steps(scans.number[rows[1:]], distance, turn, np.diff(scans.time[rows]), jitter, driven)


def _motions(pose: FloatArray) -> FloatArray:
    """Return the steps (n - 1, 3) between poses (n, 3): ahead and aside of the first of both, and the turn."""
    step, heading = np.diff(pose, axis=0), pose[:-1, 2]
    cosine, sine = np.cos(heading), np.sin(heading)
    x, y, turn = step.T
    return np.column_stack([cosine * x + sine * y, cosine * y - sine * x, turn])


def _usual(distance: FloatArray) -> float:
    moving = distance[distance > STILL]
    return float(np.median(moving)) if len(moving) else 0.0


def _are_far(steps: _Steps) -> tuple[NDArray[np.bool_], NDArray[np.bool_], float]:
    """Return which steps lead too far away, which turn too far, and the share of those beyond what robots do.

    Too far is also far beside the log's own steps, and of poses that jitter beyond what that makes.
    """
    timed, by_jitter = steps.seconds > 0, (0.0, 0.0)
    if steps.jitter.is_jitter:
        by_jitter = (BEYOND_JITTER * steps.jitter.metres, BEYOND_JITTER * steps.jitter.radians)
    reach = SPEED * np.where(timed, steps.seconds, np.inf)
    fast = (steps.distance > np.maximum(STEP, reach)) & (steps.distance > by_jitter[0])
    turned = (steps.turn > np.maximum(TURN, reach)) | (~timed & (steps.turn > FAR_TURN))
    turned &= steps.turn > by_jitter[1]
    share = float(np.mean(fast | turned)) if len(fast) else 0.0
    usual, usual_turn = _usual(steps.distance), float(np.median(steps.turn)) if share else 0.0
    far = (steps.distance > max(STEP, FAR_STEP * usual)) & (steps.distance > by_jitter[0])
    least = FAR_TURN if share > FAR_APART else 0.0  # by a clock that does not fit the steps, turns are not fast
    return (
        (fast & (steps.distance > FAST_STEP * usual)) | far,
        turned & (steps.turn > max(FAST_STEP * usual_turn, least)),
        share,
    )


def _largest(steps: _Steps, size: FloatArray, chosen: NDArray[np.bool_], form: str, unit: str) -> str:
    """Return the largest of the chosen steps in words."""
    worst = int(np.argmax(np.where(chosen, size, -1.0)))
    return f"by {size[worst]:{form}} {unit} at scan {steps.number[worst]}"


def listed(numbers: tuple[int, ...], word: str) -> str:
    """Return ``scan 5`` or ``scans 5, 8, ... (12 in all)``."""
    shown = ", ".join(map(str, numbers[:MOST_LISTED]))
    if len(numbers) == 1:
        return f"{word} {shown}"
    return f"{word}s {shown}" + (f" ... ({len(numbers)} in all)" if len(numbers) > MOST_LISTED else "")
