"""First hits of beams in a 2.5D scene: walls with holes, sheets, posts, foliage, ground, and what moves.

Every solid is vertical or flat or thin, so a uniform grid over x and y finds the few that a beam can meet.
"""

from typing import Any, NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints32, jit, part

NOTHING = -1
"""Item number of a beam without a return."""

GOLDEN = 0.6180339887498949
"""Step of the additive sequence that gives each volume of foliage its own draw from a beam's one."""


class Scene(NamedTuple):
    """What beams can hit; items are numbered walls, sheets, posts, blobs, movers, and last the ground z = 0."""

    # (n, 15) vertical rectangles: x, y of one end, unit direction (2), length, z0, z1, and a grid of holes: first u,
    # period in u, width, end of the grid in u, and the same four in z; width 0 is a wall without holes
    walls: Floats
    # (n, 12) parallelograms: corner (3), normal (3), and two vectors (3 + 3) whose products with a point's offset from
    # the corner are its coordinates, both in [0, 1] inside
    sheets: Floats
    posts: Floats  # (n, 5) vertical cylinders without lids: x, y, radius, z0, z1
    blobs: Floats  # (n, 6) spheroids of foliage: centre (3), horizontal and vertical radius, returns per metre of path
    # (n, 13) vertical cylinders and boxes that move evenly: is a box (0 or 1), x, y at t0, velocity (2), t0, t1 (absent
    # before and after), half length or radius, half width, z0, z1, cosine and sine of the heading
    movers: Floats
    cell_start: Ints32  # (nx * ny + 1,) items of the still ones in each cell, row by row
    cell_items: Ints32
    grid: Floats  # (3,) x and y of the grid's corner, and the side of a cell
    grid_shape: Ints32  # (2,) nx, ny


@part
def in_hole(value: float, first: float, period: float, width: float, end: float) -> Any:
    """Whether one coordinate lies in an opening of a periodic row of them."""
    if value < first or value >= end or width <= 0.0:
        return False
    offset = value - first
    return offset - np.floor(offset / period) * period < width


# Each kind has a loop of its own over the items of a cell, as a call for each item would count references to the
# arrays each time (4 x slower). `best` and `found` are the distance and the number of the nearest item so far.


@part
def nearest_wall(w: Any, items: Any, span: Any, o: Any, d: Any, best: float, found: int) -> Any:
    """Nearest hit of the walls ``items[span[0]:span[1]]``, if it is nearer than `best`; holes let beams through."""
    for place in range(span[0], span[1]):
        k = items[place]
        across = d[0] * w[k, 3] - d[1] * w[k, 2]
        px, py = w[k, 0] - o[0], w[k, 1] - o[1]
        # A beam along the wall gives inf or nan, which fail every comparison.
        distance = (px * w[k, 3] - py * w[k, 2]) / across
        if not 0.0 < distance < best:
            continue
        u = (px * d[1] - py * d[0]) / across
        z = o[2] + distance * d[2]
        if u < 0.0 or u > w[k, 4] or z < w[k, 5] or z > w[k, 6]:
            continue
        if in_hole(u, w[k, 7], w[k, 8], w[k, 9], w[k, 10]) and in_hole(z, w[k, 11], w[k, 12], w[k, 13], w[k, 14]):
            continue
        best, found = distance, k
    return best, found


@part
def nearest_sheet(s: Any, items: Any, span: Any, base: int, o: Any, d: Any, best: float, found: int) -> Any:
    """Nearest hit of parallelograms, of which the first has number `base`."""
    for place in range(span[0], span[1]):
        k = items[place] - base
        across = s[k, 3] * d[0] + s[k, 4] * d[1] + s[k, 5] * d[2]
        rx, ry, rz = o[0] - s[k, 0], o[1] - s[k, 1], o[2] - s[k, 2]
        distance = -(s[k, 3] * rx + s[k, 4] * ry + s[k, 5] * rz) / across
        if not 0.0 < distance < best:
            continue
        x, y, z = rx + distance * d[0], ry + distance * d[1], rz + distance * d[2]
        u = s[k, 6] * x + s[k, 7] * y + s[k, 8] * z
        v = s[k, 9] * x + s[k, 10] * y + s[k, 11] * z
        if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0:
            best, found = distance, items[place]
    return best, found


@part
def hit_cylinder(rx: float, ry: float, radius: float, z0: float, z1: float, oz: float, d: Any) -> Any:
    """Distance to the near side of a vertical cylinder, else inf; (rx, ry) is the beam's origin seen from the axis."""
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
def nearest_post(p: Any, items: Any, span: Any, base: int, o: Any, d: Any, best: float, found: int) -> Any:
    """Nearest hit of posts, of which the first has number `base`."""
    for place in range(span[0], span[1]):
        k = items[place] - base
        distance = hit_cylinder(o[0] - p[k, 0], o[1] - p[k, 1], p[k, 2], p[k, 3], p[k, 4], o[2], d)
        if distance < best:
            best, found = distance, items[place]
    return best, found


@part
def own_draw(draw: float, k: int) -> Any:
    """Draw in [0, 1) of one volume of foliage, from the beam's one."""
    moved = draw + GOLDEN * (k + 1)
    return moved - np.floor(moved)


@part
def nearest_leaf(e: Any, items: Any, span: Any, base: int, o: Any, d: Any, draw: float, best: float, found: int) -> Any:
    """Nearest return in foliage: at exponential depth behind the near surface, unless the beam leaves before."""
    for place in range(span[0], span[1]):
        k = items[place] - base
        rx, ry, rz = (o[0] - e[k, 0]) / e[k, 3], (o[1] - e[k, 1]) / e[k, 3], (o[2] - e[k, 2]) / e[k, 4]
        dx, dy, dz = d[0] / e[k, 3], d[1] / e[k, 3], d[2] / e[k, 4]
        a = dx * dx + dy * dy + dz * dz
        b = rx * dx + ry * dy + rz * dz
        disc = b * b - a * (rx * rx + ry * ry + rz * rz - 1.0)
        if disc <= 0.0:
            continue
        root = np.sqrt(disc)
        distance = max((-b - root) / a, 0.0) - np.log(1.0 - own_draw(draw, k)) / e[k, 5]
        if distance < best and distance < (-b + root) / a:
            best, found = distance, items[place]
    return best, found


@part
def enter_slab(start: float, step: float, low: float, high: float) -> Any:
    """(first, last) distance at which a beam is between two planes; an empty interval if it never is."""
    if abs(step) < 1e-12:
        return (-np.inf, np.inf) if low <= start <= high else (np.inf, -np.inf)
    a, b = (low - start) / step, (high - start) / step
    return min(a, b), max(a, b)


@part
def nearest_mover(m: Any, base: int, o: Any, d: Any, time: float, best: float, found: int) -> Any:
    """Nearest hit of what moves, where it is at `time`; a box is not seen from inside."""
    for k in range(len(m)):
        since = time - m[k, 5]
        if since < 0.0 or time > m[k, 6]:
            continue
        rx, ry = o[0] - m[k, 1] - m[k, 3] * since, o[1] - m[k, 2] - m[k, 4] * since
        if m[k, 0] == 0.0:
            distance = hit_cylinder(rx, ry, m[k, 7], m[k, 9], m[k, 10], o[2], d)
        else:
            c, s = m[k, 11], m[k, 12]
            x0, x1 = enter_slab(rx * c + ry * s, d[0] * c + d[1] * s, -m[k, 7], m[k, 7])
            y0, y1 = enter_slab(ry * c - rx * s, d[1] * c - d[0] * s, -m[k, 8], m[k, 8])
            z0, z1 = enter_slab(o[2], d[2], m[k, 9], m[k, 10])
            distance = max(x0, y0, z0)
            if distance >= min(x1, y1, z1) or distance <= 0.0:
                continue
        if distance < best:
            best, found = distance, base + k
    return best, found


@part
def first_from(items: Any, first: int, last: int, number: int) -> Any:
    """Place of the first item of a cell with this number or a higher one."""
    while first < last and items[first] < number:
        first += 1
    return first


@part
def nearest_in_cell(scene: Any, cell: int, o: Any, d: Any, draw: float, best: float, found: int) -> Any:
    """Nearest hit of a cell's items, which are in ascending order and so kind after kind."""
    items = scene.cell_items
    a, end = scene.cell_start[cell], scene.cell_start[cell + 1]
    sheets = len(scene.walls)
    posts = sheets + len(scene.sheets)
    blobs = posts + len(scene.posts)
    b = first_from(items, a, end, sheets)
    c = first_from(items, b, end, posts)
    e = first_from(items, c, end, blobs)
    if a < b:
        best, found = nearest_wall(scene.walls, items, (a, b), o, d, best, found)
    if b < c:
        best, found = nearest_sheet(scene.sheets, items, (b, c), sheets, o, d, best, found)
    if c < e:
        best, found = nearest_post(scene.posts, items, (c, e), posts, o, d, best, found)
    if e < end:
        best, found = nearest_leaf(scene.blobs, items, (e, end), blobs, o, d, draw, best, found)
    return best, found


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
        if scene.cell_start[cell] < scene.cell_start[cell + 1]:
            best, found = nearest_in_cell(scene, cell, o, d, draw, best, found)
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
    movers = len(scene.walls) + len(scene.sheets) + len(scene.posts) + len(scene.blobs)
    for b in range(len(origins)):
        o = (origins[b, 0], origins[b, 1], origins[b, 2])
        d = (directions[b, 0], directions[b, 1], directions[b, 2])
        best, found = max_range, NOTHING
        if d[2] < 0.0 and -o[2] / d[2] < max_range:
            best, found = -o[2] / d[2], movers + len(scene.movers)
        distance, item = cast_still(scene, o, d, draws[b], best)
        if item != NOTHING:
            best, found = distance, item
        best, found = nearest_mover(scene.movers, movers, o, d, times[b], best, found)
        ranges[b] = best if found != NOTHING else np.inf
        items[b] = found
