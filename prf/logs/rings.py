"""Rings of sonar transducers and their fields of view: the common ones, for logs that have none."""

from __future__ import annotations

import numpy as np

from prf.logs.readings import FloatArray, Readings
from prf.shell.errors import ConfigError, InputError

CONE = 0.349
"""Radians. Full opening angle of a sonar whose log has none: 20 degrees."""

_LEFT_FRONT = ((0.115, 0.130, 1.5708), (0.155, 0.115, 0.8727), (0.190, 0.080, 0.5236), (0.210, 0.025, 0.1745))
"""Position in metres and heading in radians on the robot, from the left to the front."""

_FRONT = (*_LEFT_FRONT, *((x, -y, -turn) for x, y, turn in reversed(_LEFT_FRONT)))
_BACK = tuple((-x, -y, turn - np.copysign(np.pi, turn)) for x, y, turn in _FRONT)

PIONEER = np.array((*_FRONT, *_BACK))
"""(16, 3): transducers of a Pioneer 2, from the left over the front to the right, then on over the back to the left;
a robot with the front array alone has the first 8. As the Player server writes them, to 0.1 mrad."""


def ring_of(n: int) -> FloatArray | None:
    """Return the (n, 3) Pioneer ring of `n` transducers, or None if there is none of that size."""
    return PIONEER[:n] if n in (8, 16) else None


def fields_of_view(readings: Readings, cone: float) -> FloatArray:
    """Return the full field of view (n,) of sonar readings, radians: the log's, or `cone` where it has none.

    Raises
    ------
    ConfigError
        If `cone` is not between 0 and pi.
    InputError
        If a field of view of the log is pi or more.
    """
    if not 0.0 < cone < np.pi:
        raise ConfigError(f"--sonar-cone {cone}: must lie between 0 and pi radians")
    view = np.where(readings.cone > 0.0, readings.cone, cone)
    if view.max() >= np.pi:
        raise InputError(f"{readings.source}: a sonar cone of {view.max():g} radians. It must be narrower than pi.")
    return view
