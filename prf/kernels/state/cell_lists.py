"""Segments listed by the cells of a grid that they pass, so that a ray or a cone meets those of its cells alone."""

from typing import NamedTuple

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import Array, core_entry
from prf.kernels.state.geometry import ray_hit
from prf.kernels.state.grid import ABS_TOL, REL_TOL, Grid, exit_distance, most_cells, walk


class SegmentLists(NamedTuple):
    """Segments by cell: those of cell i are ``listed[start[i] : start[i + 1]]``, in ascending order."""

    grid: Grid
    segments: Array  # (n, 4) f8 ends
    start: Array  # (n_cells + 1,) i8
    listed: Array  # (start[-1],) i4


@core_entry
def cells_of_segments(grid: Grid, segments: Array, path: Array, start: Array, cells: Array) -> int:
    """Write the cells that each segment (n, 4) passes, in order, while there is room; return how many all of them need.

    `start` (n + 1,) takes where those of each segment begin; `path` has room for one walk.
    """
    n = 0
    for k in range(segments.shape[0]):
        start[k] = n
        for i in range(walk(grid, segments[k, 0], segments[k, 1], segments[k, 2], segments[k, 3], path)):
            if n < cells.shape[0]:
                cells[n] = path[i]
            n += 1
    start[segments.shape[0]] = n
    return n


def room_of_cells(cells: Array, n_cells: int) -> Array:
    """Return where the list of each cell begins, (n_cells + 1,) i8, if each place in `cells` takes one entry."""
    return np.append(0, np.cumsum(np.bincount(cells, minlength=n_cells)))


def owners_by_cell(start: Array, cells: Array) -> Array:
    """Return who has each of `cells`, cell by cell, those of owner k being ``cells[start[k] : start[k + 1]]``; i4."""
    owner = np.repeat(np.arange(len(start) - 1, dtype=np.int32), np.diff(start))
    return owner[np.argsort(cells, kind="stable")]


def list_segments(grid: Grid, segments: Array) -> SegmentLists:
    """Return segments (n, 4) by the cells of a grid."""
    segments = np.ascontiguousarray(segments)
    path, start = np.empty(most_cells(grid), np.int32), np.zeros(len(segments) + 1, np.int64)
    cells = np.empty(cells_of_segments(grid, segments, path, start, np.empty(0, np.int32)), np.int32)
    cells_of_segments(grid, segments, path, start, cells)
    return SegmentLists(grid, segments, room_of_cells(cells, grid.nx * grid.ny), owners_by_cell(start, cells))


@core_entry
def first_segments(
    lists: SegmentLists, tile: Array, ray: Array, owner: Array, limit: Array, path: Array, found: Array, distance: Array
) -> None:
    """Find the first segment on each ray before its limit (n,) that does not lie inside the ray's tile `owner` (n,).

    `tile` (n_segments,) is that of each segment; NONE is no tile. Writes the segment, NONE if there is none, and its
    distance, else the limit. Columns of `ray` as of ``Beams.ray``.
    """
    for beam in range(ray.shape[0]):
        ox, oy, ux, uy = ray[beam, 0], ray[beam, 1], ray[beam, 2], ray[beam, 3]
        best = limit[beam]
        found[beam] = c.NONE
        for i in range(walk(lists.grid, ox, oy, ox + best * ux, oy + best * uy, path)):
            for at in range(lists.start[path[i]], lists.start[path[i] + 1]):
                segment = lists.listed[at]
                if owner[beam] != c.NONE and tile[segment] == owner[beam]:
                    continue
                t = ray_hit(ray[beam], lists.segments[segment])
                if t < best:
                    best = t
                    found[beam] = segment
            if best <= exit_distance(lists.grid, path[i], ox, oy, ux, uy) * (1.0 - REL_TOL) - ABS_TOL:
                break
        distance[beam] = best
