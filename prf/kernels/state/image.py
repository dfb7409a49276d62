"""Occupancy image estimated on the fly: each pixel is touched only when a change of the map touches it (1.3.3).

Two states a pixel are followed: whether its centre is black, and whether its square is not completely white (its
centre is black or an edge passes through it). Each state's time in steps is added up when it ends.
"""

from typing import NamedTuple

import numpy as np

from prf.kernels._jit import Array, core, core_entry
from prf.kernels.state.geometry import loop_box
from prf.kernels.state.grid import Grid, axis_index, walk


class Image(NamedTuple):
    """Pixels over the window; `grid` has its corner in the window's lower left corner."""

    grid: Grid
    black: Array  # (n_pixels,) u1 colour of the centre
    n_edges: Array  # (n_pixels,) i4 edges that pass through the square
    black_since: Array  # (n_pixels,) i8 step up to which black time is added up
    black_time: Array  # (n_pixels,) i8 steps with a black centre
    mixed_since: Array  # (n_pixels,) i8
    mixed_time: Array  # (n_pixels,) i8 steps in which the square is not completely white
    path: Array  # scratch for one walk
    crossings: Array  # (2 MOST_CHANGES,) f8 scratch for one row of pixels


@core
def settle(image: Image, pixel: int, step: int) -> None:
    """Add up the time of both states of a pixel up to `step`."""
    if image.black[pixel] != 0:
        image.black_time[pixel] += step - image.black_since[pixel]
    if image.black[pixel] != 0 or image.n_edges[pixel] > 0:
        image.mixed_time[pixel] += step - image.mixed_since[pixel]
    image.black_since[pixel] = step
    image.mixed_since[pixel] = step


@core_entry
def settle_all(image: Image, step: int) -> None:
    """Bring every pixel's times up to `step`."""
    for pixel in range(image.black.size):
        settle(image, pixel, step)


@core
def count_edge(image: Image, xy: Array, change: int, step: int) -> None:
    """Add `change` to the number of edges in the pixels that the edge with ends `xy` (4,) passes."""
    n = walk(image.grid, xy[0], xy[1], xy[2], xy[3], image.path)
    for k in range(n):
        pixel = image.path[k]
        settle(image, pixel, step)
        image.n_edges[pixel] += change


@core
def row_crossings(crossings: Array, loop: Array, n: int, y: float) -> int:
    """Write where the loop crosses the row `y`, sorted; return how often."""
    found = 0
    k = n - 1
    for i in range(n):
        yi = loop[i, 1]
        yk = loop[k, 1]
        if (yi > y) != (yk > y):
            x = loop[i, 0] + (y - yi) / (yk - yi) * (loop[k, 0] - loop[i, 0])
            place = found
            while place > 0 and crossings[place - 1] > x:
                crossings[place] = crossings[place - 1]
                place -= 1
            crossings[place] = x
            found += 1
        k = i
    return found


@core
def first_centre(grid: Grid, x: float) -> int:
    """First column whose centre lies at or right of x."""
    return min(max(int(np.ceil((x - grid.x0) / grid.cell - 0.5)), 0), grid.nx)


@core
def recolor_inside(image: Image, loop: Array, n: int, step: int) -> None:
    """Turn the colour of every pixel whose centre lies inside the loop of `n` corners."""
    grid = image.grid
    _, y_min, _, y_max = loop_box(loop, n)
    k0 = axis_index((y_min - grid.y0) / grid.cell, grid.ny)
    k1 = axis_index((y_max - grid.y0) / grid.cell, grid.ny)
    for k in range(k0, k1 + 1):
        found = row_crossings(image.crossings, loop, n, grid.y0 + (k + 0.5) * grid.cell)
        for pair in range(0, found - 1, 2):
            start = first_centre(grid, image.crossings[pair])
            end = first_centre(grid, image.crossings[pair + 1])
            for i in range(start, end):
                pixel = i + grid.nx * k
                settle(image, pixel, step)
                image.black[pixel] = 1 - image.black[pixel]


@core_entry
def count_edges(image: Image, segments: Array, step: int) -> None:
    """Count the edges (n, 4) in every pixel from nothing; times must be settled up to `step`."""
    image.n_edges[:] = 0
    for k in range(segments.shape[0]):
        count_edge(image, segments[k], 1, step)
