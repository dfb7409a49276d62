"""What readings saw: the cells that one of them crossed or ended in. Of all others a map knows the prior alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.score.passed_cells import count_passes, mark_cones
from prf.kernels.state.grid import Grid, most_cells
from prf.model.laser import unit_vectors, window_exit
from prf.model.sonar import SonarModel, make_poses
from prf.model.window import Window

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def beam_ends(window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float) -> tuple[Floats, Bools]:
    """Return where beams end inside the window and within reach (n, 2), and which of them (n,) by a return.

    `origin` (n, 2), `angle` (n,), `ranges` (n,).
    """
    direction = unit_vectors(angle)
    reach = np.minimum(window_exit(window, origin, direction), max_range)
    returned: Bools = ranges < reach
    return origin + np.where(returned, ranges, reach)[:, None] * direction, returned


def seen_by_beams(grid: Grid, window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float) -> Bools:
    """Return which cells (ny, nx) of a grid beams crossed or ended in; parameters as of :func:`beam_ends`."""
    passes = np.zeros((grid.ny, grid.nx), np.int64)
    end, _ = beam_ends(window, origin, angle, ranges, max_range)
    path = np.empty(most_cells(grid), np.int32)
    count_passes(grid, np.ascontiguousarray(origin), np.ascontiguousarray(end), path, passes.reshape(-1))
    seen: Bools = passes > 0
    return seen


def seen_by_cones(
    grid: Grid, window: Window, origin: Floats, angle: Floats, cone: Floats, ranges: Floats, max_range: float
) -> Bools:
    """Return which cells (ny, nx) of a grid sonar cones covered up to their readings, or without return their reach.

    `origin` (n, 2), `angle` (n,), `cone` (n,), `ranges` (n,).
    """
    seen: Bools = np.zeros((grid.ny, grid.nx), np.bool_)
    room = min(2 * math.ceil(max_range / grid.cell) + 3, max(grid.nx, grid.ny)) ** 2
    pose = make_poses(SonarModel(max_range=max_range), origin, angle, cone, ranges, window)
    reach = np.minimum(ranges, pose[:, MAX_DISTANCE])
    mark_cones(grid, pose, reach, np.empty(room, np.int32), np.empty(room), seen.reshape(-1))
    return seen
