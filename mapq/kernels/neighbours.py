"""Exact k nearest neighbours of points that are sorted along the Morton curve.

The octree is walked cell by cell down to leaves of a few points. The points of a leaf share the search: whatever
lies in the 27 cells round the leaf is a candidate for each of them. Who finds fewer than k candidates nearer than the
border of that block continues alone in the block of the leaf's parent, and in the end down the whole tree.
"""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Codes, Floats, Ints, Ints32, core, jit, part
from mapq.kernels.block_search import (
    PLACES,
    Candidates,
    divide,
    gather,
    insert,
    list_runs,
    own_place,
    rank_nearest,
    split,
)
from mapq.kernels.cells import LEVELS, gather_bits

LEAF = 20
"""A cell with more points is divided. At k = 16 the time differs by a tenth from 16 to 26."""
OPEN = -2
"""First neighbour of a point that has not been searched for."""
GUESS = 1.25
"""Times the squared radius of the point before: a circle that holds enough points in nine cases of ten."""
CROWD = 1500
"""From so many candidates on, walking the tree costs less than looking at all of them."""
BRINK = 1.0 + 1e-9
"""Bounds from the triangle inequality are taken a little wider, for rounding."""
BRIM = 1.0 - 1e-9
"""A point on the border of two cells may be numbered into either: trust the block's margin a little less."""


class Cloud(NamedTuple):
    """Points sorted along the curve, and which of them want neighbours."""

    xyz: Floats  # (n, 3)
    code: Codes  # (n,) ascending
    frame: Floats  # (4,) corner of the root, and its side
    before: Ints32  # (n + 1,) points wanted before each: its row of the result


@core
def cell_corner(code: np.uint64, level: int, frame: Floats) -> tuple[tuple[float, float, float], float]:
    """Return the lowest corner of the cell of `level` that holds a number, and its width."""
    width = frame[3] / (1 << level)
    x = frame[0] + (gather_bits(code >> np.uint64(2)) >> (LEVELS - level)) * width
    y = frame[1] + (gather_bits(code >> np.uint64(1)) >> (LEVELS - level)) * width
    z = frame[2] + (gather_bits(code) >> (LEVELS - level)) * width
    return (x, y, z), width


@core
def margin(xyz: Floats, i: int, corner: tuple[float, float, float], width: float) -> float:
    """Return the distance from point i to the border of the 27 cells round its cell."""
    nearest = np.inf
    for axis in range(3):
        inside = xyz[i, axis] - corner[axis]
        nearest = min(nearest, inside + width, 2.0 * width - inside)
    return nearest * BRIM


@core
def distance_to_cell(cloud: Cloud, i: int, code: np.uint64, level: int) -> float:
    """Return a lower bound of the squared distance from point i to the cell of `level` that holds `code`."""
    corner, width = cell_corner(code, level, cloud.frame)
    total = 0.0
    for axis in range(3):
        outside = max(corner[axis] - cloud.xyz[i, axis], cloud.xyz[i, axis] - (corner[axis] + width), 0.0)
        total += outside * outside
    return total * BRIM


@core
def octant_towards(cloud: Cloud, i: int, code: np.uint64, level: int) -> int:
    """Child of the cell of `level` that holds `code` on the side of point i."""
    width = cloud.frame[3] / (1 << (level + 1))
    towards = 0
    for axis in range(3):
        cell = gather_bits(code >> np.uint64(2 - axis)) >> (LEVELS - level)
        towards = 2 * towards + int(cloud.xyz[i, axis] > cloud.frame[axis] + (2 * cell + 1) * width)
    return towards


@core
def walk_tree(cloud: Cloud, i: int, max_d2: float, stack: Ints, start: Ints, best: Floats, index: Ints) -> int:
    """List the nearest to point i among all within a squared distance, nearest cells first; return how many."""
    xyz, size, n_best = cloud.xyz, len(best), 0
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, len(xyz), 0
    top = 1
    while top > 0:
        top -= 1
        low, high, level = stack[top, 0], stack[top, 1], stack[top, 2]
        if distance_to_cell(cloud, i, cloud.code[low], level) > (best[size - 1] if n_best == size else max_d2):
            continue
        if high - low <= LEAF or level == LEVELS:
            for j in range(low, high):
                if j != i:
                    dx, dy, dz = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
                    n_best = insert(best, index, n_best, dx * dx + dy * dy + dz * dz, j)
            continue
        split(cloud.code, low, high, level + 1, start)
        towards = octant_towards(cloud, i, cloud.code[low], level)
        for far in range(7, -1, -1):
            octant = far ^ towards
            if start[octant + 1] > start[octant]:
                stack[top, 0], stack[top, 1], stack[top, 2] = start[octant], start[octant + 1], level + 1
                top += 1
    return n_best


@core
def write_row(r: int, n_best: int, found: Candidates, max_d2: float, neighbours: Ints32) -> None:
    """Write one point's list up to the squared distance `max_d2`."""
    n_kept = 0
    while n_kept < n_best and found.ordered[n_kept + 1] <= max_d2:
        neighbours[r, n_kept] = found.who[n_kept + 1]
        n_kept += 1
    for c in range(n_kept, neighbours.shape[1]):
        neighbours[r, c] = -1


@core
def search_leaf(
    cloud: Cloud, found: Candidates, blocks: Ints, octants: Ints, depth: int, last: Floats, max_gap: float, out: Ints32
) -> int:
    """Search for the points of the leaf that `octants` leads to; return how many need the whole tree.

    The k nearest of the point before, and it, are k others within its radius plus the way to it: a bound to start from.
    `last` has that point and its radius.
    """
    xyz, k = cloud.xyz, out.shape[1]
    leaf = own_place(octants[depth] - 1)
    low, high = blocks[depth, leaf, 0], blocks[depth, leaf, 1]
    n_open = cloud.before[high] - cloud.before[low]
    for at in range(depth, max(depth - 2, -1), -1):
        n_runs, total = list_runs(blocks, at, own_place(octants[at] - 1), found.runs)
        if n_open == 0 or total > CROWD:
            break
        place = gather(xyz, found, n_runs, low)
        corner, width = cell_corner(cloud.code[low], at + 1, cloud.frame)
        for i in range(low, high):
            r = cloud.before[i]
            if cloud.before[i + 1] == r or out[r, 0] != OPEN:
                continue
            dx, dy, dz = xyz[i, 0] - last[0], xyz[i, 1] - last[1], xyz[i, 2] - last[2]
            bound = min(last[3] + np.sqrt(dx * dx + dy * dy + dz * dz), max_gap)
            guess = GUESS * last[3] * last[3]
            n_best = rank_nearest(xyz, i, found, total, place + i - low, k, guess, bound * bound * BRINK)
            if n_best == k:
                last[0], last[1], last[2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
                last[3] = np.sqrt(found.ordered[k])
            border = margin(xyz, i, corner, width)
            if border >= max_gap or (n_best == k and found.ordered[k] <= border * border):
                write_row(r, n_best, found, max_gap * max_gap, out)
                n_open -= 1
    return n_open


@core
def search_tree(
    cloud: Cloud, found: Candidates, low: int, high: int, max_gap: float, stack: Ints, start: Ints, out: Ints32
) -> None:
    """Search in the whole tree for those of the points `low` to `high` - 1 that are left."""
    best, index = found.ordered[1 : out.shape[1] + 1], found.who[1 : out.shape[1] + 1]
    for i in range(low, high):
        r = cloud.before[i]
        if cloud.before[i + 1] > r and out[r, 0] == OPEN:
            n_best = walk_tree(cloud, i, max_gap * max_gap, stack, start, best, index)
            write_row(r, n_best, found, max_gap * max_gap, out)


@part
def make_candidates() -> Candidates:
    """Return room for candidates."""
    rounded = np.empty(PLACES, np.float32)
    return Candidates(
        np.empty((28, 2), np.int64),
        np.empty((3, PLACES)),
        np.empty(PLACES, np.int64),
        np.empty(PLACES),
        rounded,
        rounded.view(np.int32),
        np.empty(PLACES, np.int32),
        np.empty(PLACES),
        np.empty(PLACES, np.int64),
    )


@jit
def find_neighbours(
    xyz: Floats, code: Codes, frame: Floats, before: Ints32, max_gap: float, neighbours: Ints32
) -> None:
    """Write the k nearest other points of each point that is wanted, nearest first, none beyond `max_gap`.

    Parameters are the fields of :class:`Cloud`. Points at equal distance are in the order of their numbers; -1 fills
    up.
    """
    cloud, found = Cloud(xyz, code, frame, before), make_candidates()
    blocks, octants = np.zeros((LEVELS, 64, 2), np.int64), np.zeros(LEVELS, np.int64)
    start, stack = np.empty(9, np.int64), np.empty((8 * LEVELS, 3), np.int64)
    last = np.array([0.0, 0.0, 0.0, np.inf])
    neighbours[:, 0] = OPEN
    split(code, 0, len(code), 1, start)
    for octant in range(8):
        blocks[0, own_place(octant), 0], blocks[0, own_place(octant), 1] = start[octant], start[octant + 1]
    depth = 0
    while depth >= 0:
        octant = octants[depth]
        if octant == 8:
            depth -= 1
            continue
        octants[depth] += 1
        place = own_place(octant)
        low, high = blocks[depth, place, 0], blocks[depth, place, 1]
        if before[high] == before[low]:
            continue
        if high - low > LEAF and depth + 1 < LEVELS:
            divide(code, blocks, depth, place, start)
            depth += 1
            octants[depth] = 0
        elif search_leaf(cloud, found, blocks, octants, depth, last, max_gap, neighbours) > 0:
            search_tree(cloud, found, low, high, max_gap, stack, start, neighbours)
