"""Squares and paths against the edges of many stored colorings.

Points are sorted by x: an edge then meets only the points of its own band of x, found by bisection
(2,000 points in 2,000 draws of 2,300 edges: 2.5 CPU seconds).
"""

import numpy as np

from prf.kernels._jit import Array, jit
from prf.kernels.state.colours import Graphs
from prf.kernels.state.geometry import point_segment_distance2, segment_distance2, segment_meets_box
from prf.kernels.state.grid import Grid


@jit
def mark_squares(points: Array, half: float, a: Array, b: Array, marked: Array) -> None:
    """Set `marked` for every point (rows sorted by x) whose closed square of half side `half` meets the edge a-b."""
    last = max(a[0], b[0]) + half
    for i in range(np.searchsorted(points[:, 0], min(a[0], b[0]) - half), points.shape[0]):
        if points[i, 0] > last:
            break
        x, y = points[i, 0], points[i, 1]
        if not marked[i] and segment_meets_box(a[0], a[1], b[0], b[1], x - half, y - half, x + half, y + half):
            marked[i] = True


@jit
def draws_mark_squares(points: Array, half: float, graphs: Graphs, marked: Array) -> None:
    """Set ``marked`` (n_draws, n_points), for points sorted by x, where an edge of the draw meets the square."""
    for draw in range(marked.shape[0]):
        first = graphs.vertex_offsets[draw]
        for e in range(graphs.edge_offsets[draw], graphs.edge_offsets[draw + 1]):
            a, b = graphs.xy[first + graphs.edges[e, 0]], graphs.xy[first + graphs.edges[e, 1]]
            mark_squares(points, half, a, b, marked[draw])


@jit
def edge_near_path(a: Array, b: Array, path: Array, radius: float) -> bool:
    """Whether the edge a-b lies within `radius` of the polyline `path`; boxes are compared before distances."""
    for piece in range(path.shape[0] - 1):
        c, d = path[piece], path[piece + 1]
        if max(a[0], b[0]) < min(c[0], d[0]) - radius or min(a[0], b[0]) > max(c[0], d[0]) + radius:
            continue
        if max(a[1], b[1]) < min(c[1], d[1]) - radius or min(a[1], b[1]) > max(c[1], d[1]) + radius:
            continue
        if segment_distance2(a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]) <= radius * radius:
            return True
    return False


@jit
def draws_clear_path(path: Array, radius: float, graphs: Graphs) -> Array:
    """Whether no edge of each draw (n_draws,) is within `radius` of the polyline `path` (two points at least)."""
    clear = np.ones(graphs.vertex_offsets.shape[0] - 1, np.bool_)
    for draw in range(clear.shape[0]):
        first = graphs.vertex_offsets[draw]
        for e in range(graphs.edge_offsets[draw], graphs.edge_offsets[draw + 1]):
            a, b = graphs.xy[first + graphs.edges[e, 0]], graphs.xy[first + graphs.edges[e, 1]]
            if edge_near_path(a, b, path, radius):
                clear[draw] = False
                break
    return clear


@jit
def draws_count_black(grid: Grid, first_black: Array, graphs: Graphs, radius: float) -> Array:
    """Number of draws (n_cells,) in which the centre of each cell is black, row by row (scan conversion).

    ``first_black`` (n_draws, ny): colours at the centres of the first column. ``radius`` above 0: draws in which the
    disc of this radius round the centre is not white; what it covers beyond the window is.
    """
    turns, count = np.empty(grid.nx * grid.ny, np.bool_), np.zeros(grid.nx * grid.ny, np.int32)
    near = np.zeros(grid.nx * grid.ny, np.bool_)
    for draw in range(first_black.shape[0]):
        turns[:] = False
        near[:] = False
        first = graphs.vertex_offsets[draw]
        for e in range(graphs.edge_offsets[draw], graphs.edge_offsets[draw + 1]):
            a, b = graphs.xy[first + graphs.edges[e, 0]], graphs.xy[first + graphs.edges[e, 1]]
            mark_crossings(grid, a, b, turns)
            if radius > 0.0:
                mark_near(grid, a, b, radius, near)
        for k in range(grid.ny):
            black = first_black[draw, k]
            for cell in range(grid.nx * k, grid.nx * (k + 1)):
                black = black != turns[cell]
                count[cell] += black or near[cell]
    return count


@jit
def mark_near(grid: Grid, a: Array, b: Array, radius: float, near: Array) -> None:
    """Set ``near`` for every cell whose centre lies within `radius` of the edge a-b."""
    low, high = min(a[1], b[1]) - radius, max(a[1], b[1]) + radius
    rise = b[1] - a[1]
    for k in range(max(0, int((low - grid.y0) / grid.cell - 0.5)), grid.ny):
        y = grid.y0 + (k + 0.5) * grid.cell
        if y > high:
            break
        begin, end = 0.0, 1.0  # the part of the edge that is as near in y
        if rise != 0.0:
            one, other = (y - radius - a[1]) / rise, (y + radius - a[1]) / rise
            begin, end = max(0.0, min(one, other)), min(1.0, max(one, other))
        x, width = a[0] + begin * (b[0] - a[0]), (end - begin) * (b[0] - a[0])
        left = int(np.floor((min(x, x + width) - radius - grid.x0) / grid.cell - 0.5))
        right = int(np.ceil((max(x, x + width) + radius - grid.x0) / grid.cell - 0.5))
        for column in range(max(0, left), min(grid.nx - 1, right) + 1):
            at = grid.x0 + (column + 0.5) * grid.cell
            if point_segment_distance2(at, y, a[0], a[1], b[0], b[1]) <= radius * radius:
                near[column + grid.nx * k] = True


@jit
def mark_crossings(grid: Grid, a: Array, b: Array, turns: Array) -> None:
    """Switch ``turns`` of the first cell right of the edge a-b, in every row whose centres' line the edge crosses."""
    low, high = min(a[1], b[1]), max(a[1], b[1])
    for k in range(max(0, int((low - grid.y0) / grid.cell - 0.5)), grid.ny):
        y = grid.y0 + (k + 0.5) * grid.cell
        if y >= high:
            break
        if y >= low:
            x = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            column = int(np.ceil((x - grid.x0) / grid.cell - 0.5))
            if 0 < column < grid.nx:
                turns[column + grid.nx * k] = not turns[column + grid.nx * k]
