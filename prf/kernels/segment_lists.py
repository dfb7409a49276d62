"""Segments listed by the cells of a grid that they pass: a ray or a cone meets those of its cells instead of all."""

import numpy as np

from prf.kernels._jit import Array, core, jit
from prf.kernels.grid import Grid, walk


@core
def count_passing(grid: Grid, segments: Array, path: Array, start: Array) -> None:
    """Set `start` (n_cells + 1,), zeros so far, to where the list of each cell begins."""
    for k in range(segments.shape[0]):
        for i in range(walk(grid, segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3], path)):
            start[path[i] + 1] += 1
    for cell in range(start.size - 1):
        start[cell + 1] += start[cell]


@core
def list_passing(grid: Grid, segments: Array, path: Array, place: Array, entries: Array) -> None:
    """Write the segments of each cell from its `place` (n_cells,) in `entries` on; places move to the ends."""
    for k in range(segments.shape[0]):
        for i in range(walk(grid, segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3], path)):
            entries[place[path[i]]] = k
            place[path[i]] += 1


@jit
def segments_by_cell(grid: Grid, segments: Array, path: Array) -> tuple[Array, Array]:
    """Segments (n, 4) by cell: where the list of each begins, (n_cells + 1,) i8, and all lists in a row, i4.

    `path` has room for one walk. The segments of cell i are ``entries[start[i] : start[i + 1]]``, in ascending order.
    """
    start = np.zeros(grid.nx * grid.ny + 1, np.int64)
    count_passing(grid, segments, path, start)
    entries = np.empty(start[-1], np.int32)
    list_passing(grid, segments, path, start[:-1].copy(), entries)
    return start, entries
