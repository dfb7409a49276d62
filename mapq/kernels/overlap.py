"""How much of two patches lies on top of one another, by occupied cells of the plane that bisects theirs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.boxes import LEAF, Trees, leaf_count
from mapq.kernels.occupied import block, cell_of, count_blocks, half_count, mark_closed
from mapq.kernels.order import quantile

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]


class Planes(NamedTuple):
    """The plane of each patch: unit normal, a point of it, a unit vector in it (m, 3 each); cell size and area (m,)."""

    normal: Floats
    centre: Floats
    across: Floats
    cell: Floats
    area: Floats


class Raster(NamedTuple):
    """Cells of a rectangle in a frame: its centre and size in u and v, its cells."""

    u: float
    v: float
    cell: float
    half_u: int
    half_v: int


@part
def dot(a: Floats, b: Floats) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def dot_from(a: Floats, point: Floats, origin: Floats) -> float:
    """Scalar product of a and the ray from `origin` to `point`."""
    return a[0] * (point[0] - origin[0]) + a[1] * (point[1] - origin[1]) + a[2] * (point[2] - origin[2])


@part
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Vector product."""
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        out[axis] = a[one] * b[two] - a[two] * b[one]


@part
def normalise(a: Floats) -> None:
    """Make a unit vector of a."""
    length = np.sqrt(dot(a, a))
    for axis in range(3):
        a[axis] /= length


@part
def bisect(planes: Planes, i: int, j: int, frame: Floats) -> float:
    """Cosine of the acute angle of two planes; frame (3, 3): two axes in the plane that bisects it, and its normal."""
    cosine = dot(planes.normal[i], planes.normal[j])
    sign = -1.0 if cosine < 0.0 else 1.0
    for axis in range(3):
        frame[2, axis] = planes.normal[i, axis] + sign * planes.normal[j, axis]
    normalise(frame[2])
    height = dot(planes.across[i], frame[2])
    for axis in range(3):
        frame[0, axis] = planes.across[i, axis] - height * frame[2, axis]
    normalise(frame[0])
    cross(frame[2], frame[0], frame[1])
    return min(abs(cosine), 1.0)


@part
def make_raster(trees: Trees, i: int, origin: Floats, frame: Floats, cell: float) -> Raster:
    """Cells over the shadow of patch i."""
    low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
    for k in range(trees.start[i], trees.start[i + 1]):
        u, v = dot_from(frame[0], trees.points[k], origin), dot_from(frame[1], trees.points[k], origin)
        low_u, high_u, low_v, high_v = min(low_u, u), max(high_u, u), min(low_v, v), max(high_v, v)
    half_u, half_v = half_count(high_u - low_u, cell), half_count(high_v - low_v, cell)
    return Raster(0.5 * (low_u + high_u), 0.5 * (low_v + high_v), cell, half_u, half_v)


@part
def mark(
    points: Floats, first: int, last: int, origin: Floats, frame: Floats, raster: Raster, bit: int, marks: Bytes
) -> None:
    """Set `bit` of the cells that points fall into."""
    n_columns = 2 * raster.half_u + 1
    for k in range(first, last):
        u, v = dot_from(frame[0], points[k], origin), dot_from(frame[1], points[k], origin)
        column = cell_of(u, raster.u, raster.cell, raster.half_u)
        row = cell_of(v, raster.v, raster.cell, raster.half_v)
        if 0 <= column < n_columns and 0 <= row <= 2 * raster.half_v:
            marks[row * n_columns + column] |= bit


@part
def mark_near(
    trees: Trees, i: int, j: int, reach: float, origin: Floats, frame: Floats, raster: Raster, marks: Bytes, stack: Ints
) -> None:
    """Set bit 2 of the cells of those points of patch j that may lie within `reach` of the box of patch i."""
    low, high, leaves = trees.low, trees.high, leaf_count(trees.start[j + 1] - trees.start[j])
    box = trees.root[i]
    stack[0] = 1
    height = 1
    while height > 0:
        height -= 1
        k = stack[height]
        node = trees.root[j] + k - 1
        apart = False
        for axis in range(3):
            apart |= low[node, axis] > high[box, axis] + reach or high[node, axis] < low[box, axis] - reach
        if apart:
            continue
        if k >= leaves:
            first = trees.start[j] + (k - leaves) * LEAF
            mark(trees.points, first, min(first + LEAF, trees.start[j + 1]), origin, frame, raster, 2, marks)
        else:
            stack[height], stack[height + 1] = 2 * k, 2 * k + 1
            height += 2


@part
def plane_distance(planes: Planes, i: int, point: Floats) -> float:
    """Signed distance of a point from the plane of patch i."""
    return dot_from(planes.normal[i], point, planes.centre[i])


@part
def plane_heights(planes: Planes, i: int, origin: Floats, frame: Floats) -> tuple[float, float, float]:
    """(h, p, q): over (u, v) of the frame the plane of patch i has the height h + p u + q v."""
    upright = dot(planes.normal[i], frame[2])
    level = dot_from(planes.normal[i], planes.centre[i], origin) / upright
    return level, -dot(planes.normal[i], frame[0]) / upright, -dot(planes.normal[i], frame[1]) / upright


@part
def shared_offsets(
    raster: Raster, marks: Bytes, wide: int, gap: tuple[float, float, float], reach: float, offsets: Floats
) -> int:
    """How many blocks hold both patches with their planes within `reach` of one another; `offsets` takes the distances.

    gap: the distance of the planes over (u, v) is ``|g + p u + q v|``.
    """
    n_columns = 2 * raster.half_u + 1
    n_shared = 0
    for row in range(2 * raster.half_v + 1 - wide):
        v = raster.v + (row + 0.5 * wide - raster.half_v) * raster.cell
        for column in range(n_columns - wide):
            u = raster.u + (column + 0.5 * wide - raster.half_u) * raster.cell
            offset = abs(gap[0] + gap[1] * u + gap[2] * v)
            if offset <= reach and block(marks, row * n_columns + column, n_columns, wide) & 12 == 12:
                offsets[n_shared] = offset
                n_shared += 1
    return n_shared


@part
def doubled(offsets: Floats, n: int, tau: float, noise: float, plain: bool) -> float:
    """How many of n shared blocks count as a double surface.

    Fewer where noise explains the offset (half of it does at 2.4 standard deviations), and, exp(-x / tau), where the
    planes are by x farther apart than where they are closest: there another weight would be due than that of the pair.
    """
    if plain:
        return float(n)
    closest = np.inf
    for k in range(n):
        closest = min(closest, offsets[k])
    total = 0.0
    for k in range(n):
        ratio = 0.5 * offsets[k] / noise
        total += (1.0 - np.exp(-0.5 * ratio * ratio)) * np.exp((closest - offsets[k]) / tau)
    return total


@jit
def overlaps(
    trees: Trees,
    planes: Planes,
    pairs: Ints,
    middle: Floats,
    reach: float,
    tau: float,
    noise: float,
    plain: bool,
) -> Floats:
    """Overlap A, shared area and offset (n, 3) of each pair of patches, the one with fewer points first.

    A is nought from 45 degrees on, and falls with cos(2 angle) up to there. The offset is the median over the shared
    area, or where there are none that of the planes where the patches come closest, along the bisecting normal; from
    45 degrees on, where that normal loses its meaning, the distance of the closest points' middle to the farther plane.
    """
    out = np.zeros((len(pairs), 3))
    frame, stack = np.zeros((3, 3)), np.empty(128, np.int64)
    marks, offsets = np.zeros(1024, np.uint8), np.zeros(1024)
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        origin = planes.centre[i]
        cosine = bisect(planes, i, j, frame)
        one, other = plane_heights(planes, i, origin, frame), plane_heights(planes, j, origin, frame)
        gap = (one[0] - other[0], one[1] - other[1], one[2] - other[2])
        facing = 2.0 * cosine * cosine - 1.0
        if facing <= 0.0:
            out[k, 2] = max(abs(plane_distance(planes, i, middle[k])), abs(plane_distance(planes, j, middle[k])))
            continue
        u, v = dot_from(frame[0], middle[k], origin), dot_from(frame[1], middle[k], origin)
        out[k, 2] = abs(gap[0] + gap[1] * u + gap[2] * v)
        cell = max(planes.cell[i], planes.cell[j])
        raster = make_raster(trees, i, origin, frame, cell)
        n_cells = (2 * raster.half_u + 1) * (2 * raster.half_v + 1)
        if n_cells > len(marks):
            marks, offsets = np.zeros(2 * n_cells, np.uint8), np.zeros(2 * n_cells)
        for cell_number in range(n_cells):
            marks[cell_number] = 0
        mark(trees.points, trees.start[i], trees.start[i + 1], origin, frame, raster, 1, marks)
        mark_near(trees, i, j, reach, origin, frame, raster, marks, stack)
        n_rows, n_columns = 2 * raster.half_v + 1, 2 * raster.half_u + 1
        mark_closed(marks, n_rows, n_columns, 1, 4)
        mark_closed(marks, n_rows, n_columns, 2, 8)
        wide = 1 if count_blocks(marks, n_rows, n_columns, 4, 1) > 0 else 0
        n_shared = shared_offsets(raster, marks, wide, gap, reach, offsets)
        if n_shared > 0:
            per_block = cell * cell / np.sqrt(0.5 * (1.0 + cosine))
            smaller = min(count_blocks(marks, n_rows, n_columns, 4, wide) * per_block, planes.area[j])
            area = facing * per_block * doubled(offsets, n_shared, tau, noise, plain)
            out[k, 0] = min(1.0, area / max(smaller, cell * cell))
            out[k, 1] = n_shared * per_block
            out[k, 2] = quantile(offsets, n_shared, 0.5)
    return out
