"""Blocks of 27 cells of an octree around a cell, and the nearest of the points in them."""

import numpy as np

from mapq.kernels._jit import Codes, Floats, Ints, part
from mapq.kernels.cells import LEVELS
from mapq.kernels.order_statistics import select


@part
def split(code: Codes, low: int, high: int, level: int, start: Ints) -> None:
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
def divide(code: Codes, blocks: Ints, depth: int, px: int, py: int, pz: int, start: Ints) -> None:
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
def count_block(blocks: Ints, depth: int, px: int, py: int, pz: int) -> int:
    """Return how many points lie in the 27 cells round a cell."""
    total = 0
    for x in range(px - 1, px + 2):
        for y in range(py - 1, py + 2):
            for z in range(pz - 1, pz + 2):
                total += blocks[depth, x, y, z, 1] - blocks[depth, x, y, z, 0]
    return total


@part
def order_block(blocks: Ints, depth: int, px: int, py: int, pz: int, runs: Ints) -> int:
    """List the runs of points in the 27 cells round a cell by number; return how many."""
    n_runs = 0
    for x in range(px - 1, px + 2):
        for y in range(py - 1, py + 2):
            for z in range(pz - 1, pz + 2):
                low, high = blocks[depth, x, y, z, 0], blocks[depth, x, y, z, 1]
                if high > low:
                    at = n_runs
                    while at > 0 and runs[at - 1, 0] > low:
                        runs[at, 0], runs[at, 1] = runs[at - 1, 0], runs[at - 1, 1]
                        at -= 1
                    runs[at, 0], runs[at, 1] = low, high
                    n_runs += 1
    return n_runs


@part
def gather_block(xyz: Floats, runs: Ints, n_runs: int, low: int, near: Floats, number: Ints) -> tuple[int, int]:
    """Copy the points of runs side by side; return how many there are, and at which place point `low` is."""
    total, place = 0, 0
    for run in range(n_runs):
        if runs[run, 0] <= low:
            place = total + low - runs[run, 0]
        for j in range(runs[run, 0], runs[run, 1]):
            near[0, total] = xyz[j, 0]
            near[1, total] = xyz[j, 1]
            near[2, total] = xyz[j, 2]
            number[total] = j
            total += 1
    return total, place


FEW = 64
"""So many numbers are ranked by comparing all with all; of more, the nearest are picked out first."""


@part
def insert(best: Floats, index: Ints, n_best: int, d2: float, j: int) -> int:
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
def list_within(squared: Floats, total: int, bound: float, listed: Ints) -> int:
    """List the places of squared distances up to a bound, without a branch; return how many."""
    n_near = 0
    for c in range(total):
        listed[n_near] = c
        n_near += squared[c] <= bound
    return n_near


@part
def rank(close: Floats, n: int, ranks: Ints) -> None:
    """Write the rank of each of the first n numbers, of equal ones in their order.

    Every number is compared with every other: for a few dozen that is faster than sorting, as it is done by vector
    instructions and never guesses a branch.
    """
    ranks[:n] = 0
    for t in range(n):
        value = close[t]
        for s in range(n):
            ranks[s] += value < close[s]
    total = 0
    for s in range(n):
        total += ranks[s]
    if total < n * (n - 1) // 2:
        for t in range(n):
            for s in range(t + 1, n):
                ranks[s] += close[t] == close[s]


@part
def scan(
    xyz: Floats,
    i: int,
    guess: float,
    bound: float,
    near: Floats,
    number: Ints,
    total: int,
    place: int,
    squared: Floats,
    close: Floats,
    listed: Ints,
    ranks: Ints,
    ordered: Floats,
    who: Ints,
    k: int,
) -> int:
    """Rank the k nearest of the candidates to point i, none beyond the squared distance `bound`; return how many.

    `guess` is a smaller bound, taken if it holds enough; `place` is that of the point itself among the candidates. It
    is first in `ordered` and `who`, which hold squared distances and numbers. Candidates are in the order of their
    numbers, and so do equal distances.
    """
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    for c in range(total):
        dx, dy, dz = near[0, c] - x, near[1, c] - y, near[2, c] - z
        squared[c] = dx * dx + dy * dy + dz * dz
    squared[place] = -1.0
    n_near = list_within(squared, total, min(guess, bound), listed)
    if n_near <= k and guess < bound:
        n_near = list_within(squared, total, bound, listed)
    for s in range(n_near):
        close[s] = squared[listed[s]]
    if n_near > max(FEW, 2 * k):
        n_near = list_within(squared, total, select(close, n_near, k), listed)
        for s in range(n_near):
            close[s] = squared[listed[s]]
    rank(close, n_near, ranks)
    for s in range(n_near):
        ordered[ranks[s]] = close[s]
        who[ranks[s]] = number[listed[s]]
    return min(n_near - 1, k)
