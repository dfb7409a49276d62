"""Exact k nearest neighbours of points that are sorted along the Morton curve.

The octree is walked cell by cell down to leaves of a few points. The points of a leaf share the search: whatever
lies in the 27 cells round the leaf is a candidate for each of them. Who finds fewer than k candidates nearer than the
border of that block continues alone in the block of the leaf's parent, and in the end down the whole tree.
"""

import numpy as np

from mapq.kernels._jit import Codes, Floats, Ints, Ints32, jit, part
from mapq.kernels.block_search import count_block, divide, gather_block, insert, order_block, scan, split
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


@part
def cell_corner(code: np.uint64, level: int, frame: Floats, corner: Floats) -> float:
    """Write the lowest corner (3,) of the cell of `level` that holds a number; return its width."""
    width = frame[3] / (1 << level)
    for axis in range(3):
        index = gather_bits(code >> np.uint64(2 - axis)) >> (LEVELS - level)
        corner[axis] = frame[axis] + index * width
    return width


@part
def margin(xyz: Floats, i: int, corner: Floats, width: float) -> float:
    """Return the distance from point i to the border of the 27 cells round its cell."""
    nearest = np.inf
    for axis in range(3):
        inside = xyz[i, axis] - corner[axis]
        nearest = min(nearest, inside + width, 2.0 * width - inside)
    return nearest * BRIM


@part
def distance_to_cell(xyz: Floats, i: int, code: np.uint64, level: int, frame: Floats) -> float:
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
    xyz: Floats, code: Codes, frame: Floats, i: int, max_d2: float, stack: Ints, start: Ints, best: Floats, index: Ints
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
def write_row(r: int, n_best: int, best: Floats, index: Ints, max_d2: float, neighbours: Ints32) -> None:
    """Write one point's list up to the squared distance `max_d2`."""
    k = neighbours.shape[1]
    n_kept = 0
    while n_kept < n_best and best[n_kept] <= max_d2:
        neighbours[r, n_kept] = index[n_kept]
        n_kept += 1
    for c in range(n_kept, k):
        neighbours[r, c] = -1


@part
def distance(xyz: Floats, i: int, j: int) -> float:
    """Return the distance of two points."""
    dx, dy, dz = xyz[i, 0] - xyz[j, 0], xyz[i, 1] - xyz[j, 1], xyz[i, 2] - xyz[j, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@part
def search_leaf(
    xyz: Floats,
    code: Codes,
    frame: Floats,
    before: Ints32,
    blocks: Ints,
    octants: Ints,
    depth: int,
    runs: Ints,
    near: Floats,
    number: Ints,
    squared: Floats,
    close: Floats,
    listed: Ints,
    ranks: Ints,
    ordered: Floats,
    who: Ints,
    corner: Floats,
    last: Floats,
    max_gap: float,
    neighbours: Ints32,
) -> int:
    """Search for the points of the leaf that `octants` leads to; return how many need the whole tree.

    The k nearest of the point before, and it, are k others within its radius plus the way to it: a bound to start from.
    `last` has that point and its radius.
    """
    k = neighbours.shape[1]
    best, index = ordered[1 : k + 1], who[1 : k + 1]
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
        n_runs = order_block(blocks, at, px, py, pz, runs)
        total, place = gather_block(xyz, runs, n_runs, low, near, number)
        width = cell_corner(code[low], at + 1, frame, corner)
        for i in range(low, high):
            r = before[i]
            if before[i + 1] == r or neighbours[r, 0] != OPEN:
                continue
            dx, dy, dz = xyz[i, 0] - last[0], xyz[i, 1] - last[1], xyz[i, 2] - last[2]
            bound = min(last[3] + np.sqrt(dx * dx + dy * dy + dz * dz), max_gap)
            guess = GUESS * last[3] * last[3]
            n_best = scan(
                xyz,
                i,
                guess,
                bound * bound * BRINK,
                near,
                number,
                total,
                place + i - low,
                squared,
                close,
                listed,
                ranks,
                ordered,
                who,
                k,
            )
            if n_best == k:
                last[0], last[1], last[2] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
                last[3] = np.sqrt(best[k - 1])
            border = margin(xyz, i, corner, width)
            if border >= max_gap or (n_best == k and best[k - 1] <= border * border):
                write_row(r, n_best, best, index, max_gap * max_gap, neighbours)
                n_open -= 1
    return n_open


@jit
def find_neighbours(
    xyz: Floats, code: Codes, frame: Floats, before: Ints32, max_gap: float, neighbours: Ints32
) -> None:
    """Write the k nearest other points of each point that is wanted, nearest first, none beyond `max_gap`.

    ``before[i]`` counts the points wanted before point i (n + 1 numbers), which is the row of the result. Points at
    equal distance are in the order of their numbers; -1 fills up. `code` is sorted; `frame` is the corner of the root
    and its side.
    """
    runs, near = np.empty((27, 2), np.int64), np.empty((3, CROWD))
    number, listed, ranks, who = (
        np.empty(CROWD, np.int64),
        np.empty(CROWD, np.int64),
        np.empty(CROWD, np.int64),
        np.empty(CROWD, np.int64),
    )
    squared, close, ordered, corner = np.empty(CROWD), np.empty(CROWD), np.empty(CROWD), np.empty(3)
    best, index = ordered[1 : neighbours.shape[1] + 1], who[1 : neighbours.shape[1] + 1]
    blocks = np.zeros((LEVELS, 4, 4, 4, 2), np.int64)
    octants = np.zeros(LEVELS, np.int64)
    start = np.empty(9, np.int64)
    stack = np.empty((8 * LEVELS, 3), np.int64)
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
            xyz,
            code,
            frame,
            before,
            blocks,
            octants,
            depth,
            runs,
            near,
            number,
            squared,
            close,
            listed,
            ranks,
            ordered,
            who,
            corner,
            last,
            max_gap,
            neighbours,
        ):
            for i in range(low, high):
                if before[i + 1] > before[i] and neighbours[before[i], 0] == OPEN:
                    n_best = walk_tree(xyz, code, frame, i, max_gap * max_gap, stack, start, best, index)
                    write_row(before[i], n_best, best, index, max_gap * max_gap, neighbours)
