"""Cells that readings crossed or ended in."""

import numpy as np

from prf.kernels._jit import core_entry
from prf.kernels.cones import cells_of_cone
from prf.kernels.grid import Grid, walk


@core_entry
def mark_beams(grid: Grid, start: np.ndarray, end: np.ndarray, path: np.ndarray, seen: np.ndarray) -> None:
    """Set `seen` (n_cells,) in every cell that a beam from `start` to `end` (n, 2) passes or ends in."""
    for beam in range(start.shape[0]):
        for k in range(walk(grid, start[beam, 0], start[beam, 1], end[beam, 0], end[beam, 1], path)):
            seen[path[k]] = True


@core_entry
def mark_cones(
    grid: Grid, pose: np.ndarray, reach: np.ndarray, cells: np.ndarray, near: np.ndarray, seen: np.ndarray
) -> None:
    """Set `seen` (n_cells,) in every cell that a cone (rows of `pose`) enters within its `reach` (n,)."""
    for cone in range(pose.shape[0]):
        for k in range(cells_of_cone(grid, pose[cone], reach[cone], cells, near)):
            seen[cells[k]] = True
