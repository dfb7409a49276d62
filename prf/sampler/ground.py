"""What readings show of the ground before any map: which cells they saw, and where their sensors drove."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from prf.model.layout import image_grid
from prf.model.window import Window
from prf.readings import PointTable, Readings
from prf.readings.driven import way_of
from prf.readings.seen import seen_by_beams, seen_by_cones


def seen_cells(
    window: Window, resolution: float, laser: Readings | None, sonar: Readings | None, points: PointTable | None
) -> NDArray[np.bool_]:
    """Return the cells (ny, nx) of the image that readings crossed or ended in; values at points concern all of it."""
    grid = image_grid(window, resolution)
    seen = np.full((grid.ny, grid.nx), points is not None)
    if laser is not None:
        seen |= seen_by_beams(grid, window, laser.origin, laser.angle, laser.range, laser.max_range)
    if sonar is not None:
        seen |= seen_by_cones(grid, window, sonar.origin, sonar.angle, sonar.cone, sonar.range, sonar.max_range)
    return seen


def driven_way(
    radius: float, logs: Sequence[Readings], sensors: Sequence[Readings], window: Window
) -> NDArray[np.float64]:
    """Return the pieces (k, 4) of the way of the sensors of `logs`; returns are those of the readings in use."""
    if radius == 0.0 or not logs:
        return np.zeros((0, 4))
    ends = np.concatenate([part.impacts() for part in sensors])
    tracks = [track for log in logs for track in sensor_tracks(log)]
    return way_of(tracks, ends, window, radius)


def sensor_tracks(readings: Readings) -> list[NDArray[np.float64]]:
    """Return the position of each device scan by scan, (n, 2) in metres: of a ring the middle of its transducers."""
    scans, number = np.unique(readings.scan, return_inverse=True)
    counts = np.bincount(number)
    middle = np.column_stack([np.bincount(number, weights=axis) / counts for axis in readings.origin.T])
    device = np.zeros(int(scans.max(initial=-1)) + 1, np.int64)
    table = readings.notes.scans
    known = table.number <= scans.max(initial=-1)
    device[table.number[known]] = table.device[known]
    return [middle[device[scans] == one] for one in np.unique(device[scans])]
