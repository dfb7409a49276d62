"""First hits of beams in a 2.5D scene: walls with holes, sheets, posts, foliage, ground, and what moves.

Every solid is vertical or flat or thin, so a uniform grid over x and y finds the few that a beam can meet.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part

NOTHING = -1
"""Item number of a beam without a return."""

GOLDEN = 0.6180339887498949
"""Step of the additive sequence that gives each volume of foliage its own draw from a beam's one."""

Array = NDArray[np.float64]


class Scene(NamedTuple):
    """What beams can hit; items are numbered walls, sheets, posts, blobs, movers, and last the ground z = 0.

    Attributes
    ----------
    walls : (n, 15) float64
        Vertical rectangles: x, y of one end, unit direction (2), length, z0, z1, and a grid of holes: first u, period
        in u, width, end of the grid in u, and the same four in z. Width 0 is a wall without holes.
    sheets : (n, 12) float64
        Parallelograms: corner (3), normal (3), and two vectors (3 + 3) whose products with a point's offset from the
        corner are its coordinates, both in [0, 1] inside.
    posts : (n, 5) float64
        Vertical cylinders without lids: x, y, radius, z0, z1.
    blobs : (n, 6) float64
        Spheroids of foliage: centre (3), horizontal and vertical radius, returns per metre of path (1/m).
    movers : (n, 13) float64
        Vertical cylinders and boxes that move evenly: is a box (0 or 1), x, y at t0, velocity (2), t0, t1 (absent
        before and after), half length or radius, half width, z0, z1, cosine and sine of the heading.
    cell_start, cell_items : (nx * ny + 1,), (k,) int32
        Items of the still ones in each cell, row by row.
    grid : (3,) float64
        x and y of the grid's corner, and the side of a cell.
    grid_shape : (2,) int32
        nx, ny.
    """

    walls: Array
    sheets: Array
    posts: Array
    blobs: Array
    movers: Array
    cell_start: NDArray[np.int32]
    cell_items: NDArray[np.int32]
    grid: Array
    grid_shape: NDArray[np.int32]


@part
def in_hole(value: float, first: float, period: float, width: float, end: float) -> Any:
    """Whether one coordinate lies in an opening of a periodic row of them."""
    if value < first or value >= end or width <= 0.0:
        return False
    offset = value - first
    return offset - np.floor(offset / period) * period < width


@part
def hit_wall(w: Any, o: Any, d: Any) -> Any:
    """Distance to a wall along the beam, inf without a hit or through a hole."""
    across = d[0] * w[3] - d[1] * w[2]
    if abs(across) < 1e-12:
        return np.inf
    px, py = w[0] - o[0], w[1] - o[1]
    distance = (px * w[3] - py * w[2]) / across
    if distance <= 0.0:
        return np.inf
    u = (px * d[1] - py * d[0]) / across
    z = o[2] + distance * d[2]
    if u < 0.0 or u > w[4] or z < w[5] or z > w[6]:
        return np.inf
    if in_hole(u, w[7], w[8], w[9], w[10]) and in_hole(z, w[11], w[12], w[13], w[14]):
        return np.inf
    return distance


@part
def hit_sheet(s: Any, o: Any, d: Any) -> Any:
    """Distance to a parallelogram along the beam, inf without a hit."""
    across = s[3] * d[0] + s[4] * d[1] + s[5] * d[2]
    if abs(across) < 1e-12:
        return np.inf
    rx, ry, rz = o[0] - s[0], o[1] - s[1], o[2] - s[2]
    distance = -(s[3] * rx + s[4] * ry + s[5] * rz) / across
    if distance <= 0.0:
        return np.inf
    x, y, z = rx + distance * d[0], ry + distance * d[1], rz + distance * d[2]
    u = s[6] * x + s[7] * y + s[8] * z
    v = s[9] * x + s[10] * y + s[11] * z
    if u < 0.0 or u > 1.0 or v < 0.0 or v > 1.0:
        return np.inf
    return distance


@part
def hit_cylinder(rx: float, ry: float, radius: float, z0: float, z1: float, oz: float, d: Any) -> Any:
    """Distance to the near side of a vertical cylinder; (rx, ry) is the beam's origin seen from the axis."""
    a = d[0] * d[0] + d[1] * d[1]
    b = rx * d[0] + ry * d[1]
    c = rx * rx + ry * ry - radius * radius
    disc = b * b - a * c
    if disc <= 0.0 or a < 1e-18:
        return np.inf
    distance = (-b - np.sqrt(disc)) / a
    z = oz + distance * d[2]
    if distance <= 0.0 or z < z0 or z > z1:
        return np.inf
    return distance


@part
def hit_blob(e: Any, o: Any, d: Any, draw: float) -> Any:
    """Distance to a return in foliage: exponential depth behind the near surface, inf if the beam passes through."""
    rx, ry = (o[0] - e[0]) / e[3], (o[1] - e[1]) / e[3]
    rz = (o[2] - e[2]) / e[4]
    dx, dy, dz = d[0] / e[3], d[1] / e[3], d[2] / e[4]
    a = dx * dx + dy * dy + dz * dz
    b = rx * dx + ry * dy + rz * dz
    disc = b * b - a * (rx * rx + ry * ry + rz * rz - 1.0)
    if disc <= 0.0:
        return np.inf
    root = np.sqrt(disc)
    near, far = max((-b - root) / a, 0.0), (-b + root) / a
    distance = near - np.log(1.0 - draw) / e[5]
    if distance >= far:
        return np.inf
    return distance


@part
def hit_box(m: Any, rx: float, ry: float, oz: float, d: Any) -> Any:
    """Distance to an upright box centred on the axis from which (rx, ry) is seen; inf from inside."""
    lx, ly = rx * m[11] + ry * m[12], ry * m[11] - rx * m[12]
    dx, dy = d[0] * m[11] + d[1] * m[12], d[1] * m[11] - d[0] * m[12]
    near, far = 0.0, np.inf
    for axis in range(3):
        if axis == 0:
            low, high, start, step = -m[7], m[7], lx, dx
        elif axis == 1:
            low, high, start, step = -m[8], m[8], ly, dy
        else:
            low, high, start, step = m[9], m[10], oz, d[2]
        if abs(step) < 1e-12:
            if start < low or start > high:
                return np.inf
            continue
        first, last = (low - start) / step, (high - start) / step
        near, far = max(near, min(first, last)), min(far, max(first, last))
    if near >= far or near <= 0.0:
        return np.inf
    return near


@part
def hit_item(scene: Any, item: int, o: Any, d: Any, draw: float) -> Any:
    """Distance to a still item by its number."""
    if item < len(scene.walls):
        return hit_wall(scene.walls[item], o, d)
    item -= len(scene.walls)
    if item < len(scene.sheets):
        return hit_sheet(scene.sheets[item], o, d)
    item -= len(scene.sheets)
    if item < len(scene.posts):
        p = scene.posts[item]
        return hit_cylinder(o[0] - p[0], o[1] - p[1], p[2], p[3], p[4], o[2], d)
    item -= len(scene.posts)
    own = draw + GOLDEN * (item + 1)
    return hit_blob(scene.blobs[item], o, d, own - np.floor(own))


@part
def hit_mover(m: Any, o: Any, d: Any, time: float) -> Any:
    """Distance to what moves, where it is at `time`."""
    if time < m[5] or time > m[6]:
        return np.inf
    rx = o[0] - m[1] - m[3] * (time - m[5])
    ry = o[1] - m[2] - m[4] * (time - m[5])
    if m[0] == 0.0:
        return hit_cylinder(rx, ry, m[7], m[9], m[10], o[2], d)
    return hit_box(m, rx, ry, o[2], d)


@part
def next_border(position: float, step: float, cell: int) -> Any:
    """Distance, in cell sides, to the border that the beam crosses next along one axis."""
    if step > 0.0:
        return (cell + 1 - position) / step
    if step < 0.0:
        return (cell - position) / step
    return np.inf


@part
def cast_still(scene: Any, o: Any, d: Any, draw: float, limit: float) -> Any:
    """(distance, item) of the nearest still item nearer than `limit`, cell by cell along the beam."""
    side = scene.grid[2]
    nx, ny = scene.grid_shape[0], scene.grid_shape[1]
    x, y = (o[0] - scene.grid[0]) / side, (o[1] - scene.grid[1]) / side
    i, j = int(np.floor(x)), int(np.floor(y))
    # In units of the distance along the beam.
    to_x, to_y = next_border(x, d[0] / side, i), next_border(y, d[1] / side, j)
    step_x = side / abs(d[0]) if d[0] != 0.0 else np.inf
    step_y = side / abs(d[1]) if d[1] != 0.0 else np.inf
    best, found = limit, NOTHING
    while 0 <= i < nx and 0 <= j < ny:
        cell = j * nx + i
        for k in range(scene.cell_start[cell], scene.cell_start[cell + 1]):
            distance = hit_item(scene, scene.cell_items[k], o, d, draw)
            if distance < best:
                best, found = distance, scene.cell_items[k]
        if best <= min(to_x, to_y):
            break
        if to_x < to_y:
            i += 1 if d[0] > 0.0 else -1
            to_x += step_x
        else:
            j += 1 if d[1] > 0.0 else -1
            to_y += step_y
    return best, found


@jit
def cast_beams(
    scene: Any, origins: Any, directions: Any, times: Any, draws: Any, max_range: float, ranges: Any, items: Any
) -> None:
    """Range and item number of the first hit of each beam, inf and `NOTHING` beyond `max_range`.

    Origins (n, 3) inside the grid, unit directions (n, 3), times (n,), draws (n,) in [0, 1) for the foliage; fills
    ranges (n,) and items (n,). The ground is the plane z = 0.
    """
    n_still = len(scene.walls) + len(scene.sheets) + len(scene.posts) + len(scene.blobs)
    for b in range(len(origins)):
        o, d = origins[b], directions[b]
        limit = max_range
        ground = False
        if d[2] < 0.0 and -o[2] / d[2] < limit:
            limit = -o[2] / d[2]
            ground = True
        best, found = cast_still(scene, o, d, draws[b], limit)
        if found == NOTHING and ground:
            found = n_still + len(scene.movers)
        for m in range(len(scene.movers)):
            distance = hit_mover(scene.movers[m], o, d, times[b])
            if distance < best:
                best, found = distance, n_still + m
        ranges[b] = best if found != NOTHING else np.inf
        items[b] = found
