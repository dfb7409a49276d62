"""Rays against walls, one pair at a time: no facing, no sweeping, no culling."""

from __future__ import annotations

import math

import numpy as np


def first_wall(walls: np.ndarray, x: float, y: float, angle: float) -> float:
    """Distance to the nearest wall on a ray, inf for none; a wall holds both its ends."""
    nearest = math.inf
    c, s = math.cos(angle), math.sin(angle)
    for x1, y1, x2, y2 in walls.tolist():
        # The wall in the frame of the ray: u along, v to the left.
        u1, v1 = (x1 - x) * c + (y1 - y) * s, (y1 - y) * c - (x1 - x) * s
        u2, v2 = (x2 - x) * c + (y2 - y) * s, (y2 - y) * c - (x2 - x) * s
        if v1 * v2 > 0.0 or v1 == v2:
            continue
        u = u1 + (u2 - u1) * v1 / (v1 - v2)
        if u > 0.0:
            nearest = min(nearest, u)
    return nearest
