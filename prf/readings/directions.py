"""Where the beams of ranges alone point, guessed: the step by straight walls, the first by how scans agree at poses."""

from __future__ import annotations

import math

import numpy as np

from prf.readings.text import FloatArray

VIEWS = (180.0, 240.0, 270.0, 360.0)
"""Degrees that scanners see. With an odd number of beams the last is at the end, else a step before it."""
MOST_SCANS = 200
SPREAD = 24
"""The points compared are a part like this of a scan apart."""
NEAR = 0.1
"""By which part of themselves ranges of one wall differ over that at most, and metres."""
ROUNDS = (0.05, 0.03, 0.02, 0.02, 0.02)
"""How near the median bends are of which it is taken again."""
FEWEST = 200
"""Places in walls by which fields of view are compared."""
CELL = 0.1
"""Metres: scans agree where their returns lie in few cells of this size."""


def usual_angles(width: int, view: float = 180.0) -> str:
    """Return FIRST:STEP:LAST in degrees of beams, counter-clockwise and symmetric about straight ahead."""
    step = view / (width - width % 2)
    first = -0.5 * step * (width - 1) if view == 240.0 else -0.5 * view
    return as_angles(first, step, width)


def as_angles(first: float, step: float, width: int) -> str:
    """Return directions as ``--beam-angles`` takes them."""
    return f"{first:.8g}:{step:.8g}:{first + step * (width - 1):.8g}"


def guess_angles(ranges: FloatArray, poses: FloatArray | None = None) -> tuple[str, str]:
    """Return FIRST:STEP:LAST in degrees of ranges (n, w), metres, and in words why.

    `poses` (n, 3): x, y and heading, metres and radians, of the scans. Without them the beams are taken to run
    counter-clockwise, symmetric about straight ahead.
    """
    width = ranges.shape[1]
    bent = {view: bend(ranges, view) for view in VIEWS}
    known = {view: value for view, value in bent.items() if value == value}
    view, why = 180.0, "as most scanners have it"
    if known:
        view, why = min(known, key=lambda each: known[each]), "by which walls are straightest"
    usual = usual_angles(width, view)
    if poses is None:
        return usual, f"{why}; counter-clockwise about straight ahead is assumed"
    first, step = map(float, usual.split(":")[:2])
    starts = {(first, step), (-first, -step)}
    if view == 360.0:
        starts |= {(0.0, step), (0.0, -step)}
    best = min(sorted(starts), key=lambda each: n_cells(ranges, poses, *each))
    return as_angles(*best, width), f"{why}, and scans agree best"


def bend(ranges: FloatArray, view: float) -> float:
    """Return how bent walls are that beams over `view` degrees see; nan where few are seen.

    Of three returns on one wall: how far the middle one is to one side of the line through the others, over their
    distance. Noise goes to both sides, a wrong field of view to one; the median of those near it, as corners are bent.
    """
    chosen = ranges[:: 1 + len(ranges) // MOST_SCANS]
    width = chosen.shape[1]
    apart = max(1, width // SPREAD)
    turn = math.radians(view) / (width - width % 2) * apart
    left, middle, right = chosen[:, : -2 * apart], chosen[:, apart:-apart], chosen[:, 2 * apart :]
    with np.errstate(invalid="ignore"):
        room = NEAR + NEAR * middle
        on_wall = (np.abs(left - middle) < room) & (np.abs(right - middle) < room) & (np.minimum(left, right) > 0.0)
    if np.count_nonzero(on_wall) < FEWEST:
        return math.nan
    a, b = left[on_wall] * np.exp(-1j * turn), right[on_wall] * np.exp(1j * turn)
    chord = b - a
    bent = (np.conj(chord) * (middle[on_wall] - a)).imag / np.abs(chord) ** 2
    centre = float(np.median(bent))
    for near in ROUNDS:
        centre = float(np.median(bent[np.abs(bent - centre) < near]))
    return abs(centre)


def n_cells(ranges: FloatArray, poses: FloatArray, first: float, step: float) -> int:
    """Return in how many cells the returns of successive scans lie, at poses (n, 3), with these directions, degrees."""
    some = slice(0, MOST_SCANS)
    direction = np.radians(first + step * np.arange(ranges.shape[1])) + poses[some, 2:3]
    reach = 0.97 * float(np.nanmax(np.where(np.isfinite(ranges), ranges, np.nan)))
    with np.errstate(invalid="ignore"):
        hit = (ranges[some] > 0.0) & (ranges[some] < reach)
        x = (poses[some, :1] + ranges[some] * np.cos(direction))[hit]
        y = (poses[some, 1:2] + ranges[some] * np.sin(direction))[hit]
    return len(np.unique(np.floor(np.column_stack([x, y]) / CELL), axis=0))
