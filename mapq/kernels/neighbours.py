"""Exact k nearest neighbours of points that are sorted along the Morton curve.

The octree is walked cell by cell down to leaves of a few points. The points of a leaf share the search: whatever
lies in the 27 cells round the leaf is a candidate for each of them. Who finds fewer than k candidates nearer than the
border of that block goes on alone in the block of the leaf's parent, and in the end down the whole tree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part
from mapq.kernels.cells import LEVELS, gather_bits

LEAF = 20
"""A cell with more points is divided. At k = 16 the time differs by a tenth from 16 to 26."""
OPEN = -2
"""First neighbour of a point that has not been searched for."""
CROWD = 1500
"""From so many candidates on, walking the tree costs less than looking at all of them."""
BRINK = 1.0 + 1e-9
"""Bounds from the triangle inequality are taken a little wider, for rounding."""
BRIM = 1.0 - 1e-9
"""A point on the border of two cells may be numbered into either: trust the block's margin a little less."""


@part
def insert(best: NDArray[np.float64], index: NDArray[np.int64], n_best: int, d2: float, j: int) -> int:
    """Put point `j` into a list sorted by distance and then number; return its length, at most the list's size."""
    size = len(best)
    if n_best == size:
        if d2 > best[size - 1] or (d2 == best[size - 1] and j > index[size - 1]):
            return size
        n_best = size - 1
    at = n_best
    while at > 0 and d2 < best[at - 1]:
        best[at] = best[at - 1]
        index[at] = index[at - 1]
        at -= 1
    while at > 0 and d2 == best[at - 1] and j < index[at - 1]:
        best[at] = best[at - 1]
        index[at] = index[at - 1]
        at -= 1
    best[at] = d2
    index[at] = j
    return n_best + 1


@part
def split(code: NDArray[np.uint64], low: int, high: int, level: int, start: NDArray[np.int64]) -> None:
    """Write where the eight cells of `level` begin among the points low to high - 1 of their parent."""
    shift = np.uint64(3 * (LEVELS - level))
    begin = low
    start[0] = low
    for octant in range(1, 8):
        end = high
        while begin < end:
            middle = (begin + end) >> 1
            if np.int64((code[middle] >> shift) & np.uint64(7)) < octant:
                begin = middle + 1
            else:
                end = middle
        start[octant] = begin
    start[8] = high


@part
def divide(
    code: NDArray[np.uint64], blocks: NDArray[np.int64], depth: int, px: int, py: int, pz: int, start: NDArray[np.int64]
) -> None:
    """Write the 4 x 4 x 4 cells round a cell's eight children from the 3 x 3 x 3 cells round the cell itself."""
    for x in range(3):
        for y in range(3):
            for z in range(3):
                sx, sy, sz = px + x - 1, py + y - 1, pz + z - 1
                split(code, blocks[depth, sx, sy, sz, 0], blocks[depth, sx, sy, sz, 1], depth + 2, start)
                for octant in range(8):
                    gx, gy, gz = 2 * x + (octant >> 2) - 1, 2 * y + ((octant >> 1) & 1) - 1, 2 * z + (octant & 1) - 1
                    if min(gx, gy, gz) >= 0 and max(gx, gy, gz) <= 3:
                        blocks[depth + 1, gx, gy, gz, 0] = start[octant]
                        blocks[depth + 1, gx, gy, gz, 1] = start[octant + 1]


@part
def count_block(blocks: NDArray[np.int64], depth: int, px: int, py: int, pz: int) -> int:
    """Return how many points lie in the 27 cells round a cell."""
    total = 0
    for x in range(px - 1, px + 2):
        for y in range(py - 1, py + 2):
            for z in range(pz - 1, pz + 2):
                total += blocks[depth, x, y, z, 1] - blocks[depth, x, y, z, 0]
    return total


@part
def gather_block(
    xyz: NDArray[np.float64],
    blocks: NDArray[np.int64],
    depth: int,
    px: int,
    py: int,
    pz: int,
    near: NDArray[np.float64],
    number: NDArray[np.int64],
) -> int:
    """Copy the points of the 27 cells round a cell side by side; return how many."""
    total = 0
    for x in range(px - 1, px + 2):
        for y in range(py - 1, py + 2):
            for z in range(pz - 1, pz + 2):
                for j in range(blocks[depth, x, y, z, 0], blocks[depth, x, y, z, 1]):
                    near[0, total] = xyz[j, 0]
                    near[1, total] = xyz[j, 1]
                    near[2, total] = xyz[j, 2]
                    number[0, total] = j
                    total += 1
    return total


@part
def scan(
    xyz: NDArray[np.float64],
    i: int,
    bound: float,
    near: NDArray[np.float64],
    number: NDArray[np.int64],
    total: int,
    best: NDArray[np.float64],
    index: NDArray[np.int64],
) -> int:
    """List the nearest of the candidates to point i, none beyond the squared distance `bound`; return how many.

    Candidates within the bound are first moved together without a branch, to the last rows of `near` and `number`,
    which halves the time.
    """
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    n_near = 0
    for c in range(total):
        dx, dy, dz = near[0, c] - x, near[1, c] - y, near[2, c] - z
        d2 = dx * dx + dy * dy + dz * dz
        near[3, n_near] = d2
        number[1, n_near] = number[0, c]
        n_near += d2 <= bound
    n_best = 0
    worst = np.inf
    for c in range(n_near):
        if near[3, c] <= worst and number[1, c] != i:
            n_best = insert(best, index, n_best, near[3, c], number[1, c])
            if n_best == len(best):
                worst = best[n_best - 1]
    return n_best


@part
def margin(xyz: NDArray[np.float64], i: int, code: NDArray[np.uint64], level: int, frame: NDArray[np.float64]) -> float:
    """Return the distance from point i to the border of the 27 cells round its cell of `level`."""
    width = frame[3] / (1 << level)
    nearest = np.inf
    for axis in range(3):
        index = gather_bits(code[i] >> np.uint64(2 - axis)) >> (LEVELS - level)
        inside = xyz[i, axis] - (frame[axis] + index * width)
        nearest = min(nearest, inside + width, 2.0 * width - inside)
    return nearest * BRIM


@part
def distance_to_cell(
    xyz: NDArray[np.float64], i: int, code: np.uint64, level: int, frame: NDArray[np.float64]
) -> float:
    """Return a lower bound of the squared distance from point i to the cell of `level` that holds `code`."""
    width = frame[3] / (1 << level)
    total = 0.0
    for axis in range(3):
        index = gather_bits(code >> np.uint64(2 - axis)) >> (LEVELS - level)
        start = frame[axis] + index * width
        outside = max(start - xyz[i, axis], xyz[i, axis] - (start + width), 0.0)
        total += outside * outside
    return total * BRIM


@part
def walk_tree(
    xyz: NDArray[np.float64],
    code: NDArray[np.uint64],
    frame: NDArray[np.float64],
    i: int,
    max_d2: float,
    stack: NDArray[np.int64],
    start: NDArray[np.int64],
    best: NDArray[np.float64],
    index: NDArray[np.int64],
) -> int:
    """List the nearest to point i among all within a squared distance, nearest cells first; return how many."""
    size = len(best)
    n_best = 0
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(xyz), 0
    top = 1
    while top > 0:
        top -= 1
        low, high, level = stack[top, 0], stack[top, 1], stack[top, 2]
        if distance_to_cell(xyz, i, code[low], level, frame) > (best[size - 1] if n_best == size else max_d2):
            continue
        if high - low <= LEAF or level == LEVELS:
            for j in range(low, high):
                if j != i:
                    dx, dy, dz = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
                    n_best = insert(best, index, n_best, dx * dx + dy * dy + dz * dz, j)
            continue
        split(code, low, high, level + 1, start)
        width = frame[3] / (1 << (level + 1))
        towards = 0
        for axis in range(3):
            cell = gather_bits(code[low] >> np.uint64(2 - axis)) >> (LEVELS - level)
            beyond = xyz[i, axis] > frame[axis] + (2 * cell + 1) * width
            towards = 2 * towards + int(beyond)
        for far in range(7, -1, -1):
            octant = far ^ towards
            if start[octant + 1] > start[octant]:
                stack[top, 0], stack[top, 1], stack[top, 2] = start[octant], start[octant + 1], level + 1
                top += 1
    return n_best


@part
def write_row(
    r: int,
    n_best: int,
    best: NDArray[np.float64],
    index: NDArray[np.int64],
    max_d2: float,
    neighbours: NDArray[np.int32],
) -> None:
    """Write one point's list up to the squared distance `max_d2`."""
    n_kept = 0
    while n_kept < n_best and best[n_kept] <= max_d2:
        neighbours[r, n_kept] = index[n_kept]
        n_kept += 1
    for c in range(n_kept, neighbours.shape[1]):
        neighbours[r, c] = -1


@part
def distance(xyz: NDArray[np.float64], i: int, j: int) -> float:
    """Return the distance of two points."""
    dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@part
def search_leaf(
    xyz: NDArray[np.float64],
    code: NDArray[np.uint64],
    frame: NDArray[np.float64],
    before: NDArray[np.int32],
    blocks: NDArray[np.int64],
    octants: NDArray[np.int64],
    depth: int,
    near: NDArray[np.float64],
    number: NDArray[np.int64],
    best: NDArray[np.float64],
    index: NDArray[np.int64],
    last: NDArray[np.float64],
    max_gap: float,
    neighbours: NDArray[np.int32],
) -> int:
    """Search for the points of the leaf that `octants` tells; return how many need the whole tree.

    The k nearest of the point before, and it, are k others within its radius plus the way to it: a bound to start from.
    `last` has that point and its radius.
    """
    k = neighbours.shape[1]
    octant = octants[depth] - 1
    px, py, pz = 1 + (octant >> 2), 1 + ((octant >> 1) & 1), 1 + (octant & 1)
    low, high = blocks[depth, px, py, pz, 0], blocks[depth, px, py, pz, 1]
    n_open = before[high] - before[low]
    for above in range(min(2, depth + 1)):
        at = depth - above
        octant = octants[at] - 1
        px, py, pz = 1 + (octant >> 2), 1 + ((octant >> 1) & 1), 1 + (octant & 1)
        if n_open == 0 or count_block(blocks, at, px, py, pz) > CROWD:
            break
        total = gather_block(xyz, blocks, at, px, py, pz, near, number)
        for i in range(low, high):
            r = before[i]
            if before[i + 1] == r or neighbours[r, 0] != OPEN:
                continue
            dx, dy, dz = xyz[i, 0] - last[0], xyz[i, 1] - last[1], xyz[i, 2] - last[2]
            bound = min(last[3] + np.sqrt(dx * dx + dy * dy + dz * dz), max_gap)
            n_best = scan(xyz, i, bound * bound * BRINK, near, number, total, best, index)
            if n_best == k:
                last[0], last[1], last[2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
                last[3] = np.sqrt(best[k - 1])
            border = margin(xyz, i, code, at + 1, frame)
            if border >= max_gap or (n_best == k and best[k - 1] <= border * border):
                write_row(r, n_best, best, index, max_gap * max_gap, neighbours)
                n_open -= 1
    return n_open


@jit
def find_neighbours(
    xyz: NDArray[np.float64],
    code: NDArray[np.uint64],
    frame: NDArray[np.float64],
    before: NDArray[np.int32],
    max_gap: float,
    neighbours: NDArray[np.int32],
) -> None:
    """Write the k nearest other points of each point that is asked for, nearest first, none beyond `max_gap`.

    ``before[i]`` counts the points asked for before point i (n + 1 numbers), which is the row of the result. Points at
    equal distance come in the order of their numbers; -1 fills up. `code` is sorted; `frame` is the corner of the root
    and its side.
    """
    best, index = np.empty(neighbours.shape[1]), np.empty(neighbours.shape[1], np.int64)
    blocks = np.zeros((LEVELS, 4, 4, 4, 2), np.int64)
    octants = np.zeros(LEVELS, np.int64)
    start = np.empty(9, np.int64)
    stack = np.empty((8 * LEVELS, 3), np.int64)
    near, number = np.empty((4, CROWD)), np.empty((2, CROWD), np.int64)
    last = np.zeros(4)
    last[3] = np.inf
    for r in range(len(neighbours)):
        neighbours[r, 0] = OPEN
    split(code, 0, len(code), 1, start)
    for octant in range(8):
        blocks[0, 1 + (octant >> 2), 1 + ((octant >> 1) & 1), 1 + (octant & 1), 0] = start[octant]
        blocks[0, 1 + (octant >> 2), 1 + ((octant >> 1) & 1), 1 + (octant & 1), 1] = start[octant + 1]
    depth = 0
    while depth >= 0:
        octant = octants[depth]
        if octant == 8:
            depth -= 1
            continue
        octants[depth] += 1
        px, py, pz = 1 + (octant >> 2), 1 + ((octant >> 1) & 1), 1 + (octant & 1)
        low, high = blocks[depth, px, py, pz, 0], blocks[depth, px, py, pz, 1]
        if before[high] == before[low]:
            continue
        if high - low > LEAF and depth + 1 < LEVELS:
            divide(code, blocks, depth, px, py, pz, start)
            depth += 1
            octants[depth] = 0
        elif search_leaf(
            xyz, code, frame, before, blocks, octants, depth, near, number, best, index, last, max_gap, neighbours
        ):
            for i in range(low, high):
                if before[i + 1] > before[i] and neighbours[before[i], 0] == OPEN:
                    n_best = walk_tree(xyz, code, frame, i, max_gap * max_gap, stack, start, best, index)
                    write_row(before[i], n_best, best, index, max_gap * max_gap, neighbours)
