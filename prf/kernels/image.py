"""Occupancy image estimated on the fly: each pixel is touched only when a change of the map touches it (1.3.3).

Two states a pixel are followed: whether its centre is black, and whether its square is not completely white (its
centre is black or an edge passes through it). Each state's time in steps is added up when it ends.
"""

from typing import NamedTuple

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.geometry import loop_box
from prf.kernels.graph import Graph
from prf.kernels.grid import Grid, axis_index, walk


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
def count_all_edges(graph: Graph, image: Image) -> None:
    """Count the edges in every pixel from nothing; times must be settled up to the graph's step."""
    image.n_edges[:] = 0
    for i in range(graph.counts[c.EDGES]):
        count_edge(image, graph.edge_xy[graph.members[c.EDGES, i]], 1, graph.counts[c.STEP])


@core
def colour_at_left(graph: Graph) -> int:
    """Colour, 1 black, of the window's left border at half its height: that of the anchor, seen across the edges."""
    window = graph.window
    anchor_x = 0.5 * (window[0] + window[2])
    anchor_y = 0.5 * (window[1] + window[3])
    colour = graph.counts[c.ANCHOR_BLACK]
    for i in range(graph.counts[c.EDGES]):
        xy = graph.edge_xy[graph.members[c.EDGES, i]]
        crosses = (xy[1] > anchor_y) != (xy[3] > anchor_y)
        if crosses and xy[0] + (anchor_y - xy[1]) / (xy[3] - xy[1]) * (xy[2] - xy[0]) < anchor_x:
            colour = 1 - colour
    return colour


@core
def turns_on_left(graph: Graph, y: float) -> int:
    """How often, modulo 2, the colour turns along the left border between half its height and `y`."""
    middle = 0.5 * (graph.window[1] + graph.window[3])
    turns = 0
    for i in range(graph.counts[c.BOUNDARY_VERTICES]):
        v = graph.members[c.BOUNDARY_VERTICES, i]
        height = graph.vertex_xy[v, 1]
        if graph.vertex_side[v] == c.LEFT and (height > y) != (height > middle):
            turns = 1 - turns
    return turns


@core
def mark_turns(image: Image, xy: Array) -> None:
    """Mark, in every row of pixels that the edge `xy` (4,) crosses, the first one right of it; two marks cancel."""
    grid = image.grid
    high = max(xy[1], xy[3])
    for k in range(axis_index((min(xy[1], xy[3]) - grid.y0) / grid.cell, grid.ny), grid.ny):
        y = grid.y0 + (k + 0.5) * grid.cell
        if y >= high:
            break
        if (xy[1] > y) != (xy[3] > y):
            start = first_centre(grid, xy[0] + (y - xy[1]) / (xy[3] - xy[1]) * (xy[2] - xy[0]))
            if start < grid.nx:
                pixel = start + grid.nx * k
                image.black[pixel] = 1 - image.black[pixel]


@core_entry
def paint_all(graph: Graph, image: Image) -> None:
    """Set the colour of every pixel, and count the edges in each, from the map; times must be settled up to now."""
    grid = image.grid
    image.black[:] = 0
    for i in range(graph.counts[c.EDGES]):
        mark_turns(image, graph.edge_xy[graph.members[c.EDGES, i]])
    base = colour_at_left(graph)
    for k in range(grid.ny):
        colour = base ^ turns_on_left(graph, grid.y0 + (k + 0.5) * grid.cell)
        for pixel in range(grid.nx * k, grid.nx * (k + 1)):
            if image.black[pixel] != 0:
                colour = 1 - colour
            image.black[pixel] = colour
    count_all_edges(graph, image)
