"""Occupancy grids cell by cell in plain Python, as docs/scores.md defines them."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def cells_on_segment(start: Floats, end: Floats, origin: Floats, side: float) -> list[tuple[int, int]]:
    """(row, column) of the cells that a segment passes, in order: the middles between its crossings of cell borders."""
    u, v = (start - origin) / side, (end - origin) / side
    cuts = {0.0, 1.0}
    for axis in range(2):
        low, high = sorted((u[axis], v[axis]))
        for border in range(math.ceil(low), math.floor(high) + 1):
            if u[axis] != v[axis]:
                cuts.add(float((border - u[axis]) / (v[axis] - u[axis])))
    inside = sorted(cut for cut in cuts if 0.0 <= cut <= 1.0)
    middles = [0.5 * (a + b) for a, b in itertools.pairwise(inside)]
    places = [u + middle * (v - u) for middle in middles]
    return [(math.floor(y), math.floor(x)) for x, y in places]


def cells_in_cone(
    start: Floats,
    angle: float,
    cone: float,
    near: float,
    far: float,
    origin: Floats,
    side: float,
    shape: tuple[int, int],
) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Cells missed (centres nearer than `near`) and hit (from there to `far`) by a cone."""
    missed, hit = set(), set()
    for row in range(shape[0]):
        for column in range(shape[1]):
            x, y = origin + side * (np.array([column, row]) + 0.5) - start
            turn = (math.atan2(y, x) - angle + math.pi) % (2.0 * math.pi) - math.pi
            distance = math.hypot(x, y)
            if abs(turn) <= 0.5 * cone and distance < near:
                missed.add((row, column))
            elif abs(turn) <= 0.5 * cone and distance <= far:
                hit.add((row, column))
    return missed, hit


def clamped_log_odds(outcomes: list[bool], hit: float, miss: float, clamp: float) -> float:
    """Probability after a sequence of hits (True) and misses (False)."""
    total = 0.0
    for outcome in outcomes:
        p = hit if outcome else miss
        total = min(max(total + math.log(p / (1.0 - p)), -clamp), clamp)
    return 1.0 / (1.0 + math.exp(-total))
