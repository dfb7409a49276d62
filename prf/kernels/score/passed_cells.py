"""Cells that readings pass or end in: marked, counted, and kept passed when beams are left out."""

from prf.kernels._jit import Array, core_entry
from prf.kernels.readings.cones import cells_of_cone
from prf.kernels.state.grid import Grid, walk


@core_entry
def mark_cones(grid: Grid, pose: Array, reach: Array, cells: Array, near: Array, seen: Array) -> None:
    """Set `seen` (n_cells,) in every cell that a cone (rows of `pose`) enters within its `reach` (n,)."""
    for cone in range(pose.shape[0]):
        for k in range(cells_of_cone(grid, pose[cone], reach[cone], cells, near)):
            seen[cells[k]] = True


@core_entry
def count_passes(grid: Grid, start: Array, end: Array, path: Array, passes: Array) -> None:
    """Add to `passes` (n_cells,) how many beams pass each cell or end in it.

    `start` and `end` (n, 2) lie in the window; `path` has room for one walk.
    """
    for beam in range(start.shape[0]):
        for k in range(walk(grid, start[beam, 0], start[beam, 1], end[beam, 0], end[beam, 1], path)):
            passes[path[k]] += 1


@core_entry
def mark_up_to(grid: Grid, start: Array, end: Array, is_wall: Array, path: Array, seen: Array) -> None:
    """Set `seen` (n_cells,) in cells that beams pass, up to the first of a wall; parameters as of `count_passes`."""
    for beam in range(start.shape[0]):
        for k in range(walk(grid, start[beam, 0], start[beam, 1], end[beam, 0], end[beam, 1], path)):
            seen[path[k]] = True
            if is_wall[path[k]]:
                break


@core_entry
def choose_lacking(grid: Grid, start: Array, end: Array, least: int, path: Array, wanted: Array, chosen: Array) -> None:
    """Choose, in their order, beams that pass at least `least` cells in which some are still `wanted` (n_cells,)."""
    for beam in range(start.shape[0]):
        if chosen[beam]:
            continue
        n = walk(grid, start[beam, 0], start[beam, 1], end[beam, 0], end[beam, 1], path)
        gain = 0
        for k in range(n):
            if wanted[path[k]] > 0:
                gain += 1
        if gain >= least:
            chosen[beam] = True
            for k in range(n):
                wanted[path[k]] -= 1
