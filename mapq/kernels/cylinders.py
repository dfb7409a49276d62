"""Regions that grow over neighbours on one cylinder."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bools, Floats, Ints32, core, jit
from mapq.kernels.planes import Surface, Tolerance, dot


class Cylinder(NamedTuple):
    """A round surface about an axis."""

    axis: Floats  # (3,) unit vector
    centre: Floats  # (3,) a point of the axis
    radius: float  # metres


@core
def off_cylinder(surface: Surface, i: int, cylinder: Cylinder) -> tuple[float, float]:
    """Height of point i over a cylinder, and cosine of the angle between its normal and the cylinder's there."""
    x = surface.xyz[i, 0] - cylinder.centre[0]
    y = surface.xyz[i, 1] - cylinder.centre[1]
    z = surface.xyz[i, 2] - cylinder.centre[2]
    along = x * cylinder.axis[0] + y * cylinder.axis[1] + z * cylinder.axis[2]
    x, y, z = x - along * cylinder.axis[0], y - along * cylinder.axis[1], z - along * cylinder.axis[2]
    away = np.sqrt(x * x + y * y + z * z)
    return away - cylinder.radius, abs(dot(surface.normal[i], (x, y, z))) / away


@jit
def grow_cylinder(
    surface: Surface, seeds: Ints32, free: Bools, cylinder: Cylinder, tolerance: Tolerance, seen: Bools, queue: Ints32
) -> int:
    """List the points on a cylinder that neighbours connect with seeds on it in `queue`; return how many there are.

    A point is on it if it is `free`, near enough, and faces as it does. Points with a normal of nan do not lead on.
    `seen` is false everywhere, and is again afterwards.
    """
    n, head = 0, -1
    while head < n:
        around = seeds if head < 0 else surface.neighbours[queue[head]]
        if head < 0 or not np.isnan(surface.normal[queue[head], 0]):
            for j in around:
                if j < 0:
                    break
                if seen[j] or not free[j]:
                    continue
                height, cosine = off_cylinder(surface, j, cylinder)
                if abs(height) <= tolerance.max_distance and not cosine < tolerance.cos_angle:
                    seen[j] = True
                    queue[n] = j
                    n += 1
        head += 1
    for k in range(n):
        seen[queue[k]] = False
    return n
