"""Blocks of 27 cells of an octree around a cell, and the nearest of the points in them."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Codes, Floats, Ints, part
from mapq.kernels.cells import LEVELS
from mapq.kernels.order_statistics import select

AROUND = np.array([16 * x + 4 * y + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
"""Steps from a cell to the 27 round it, among 4 x 4 x 4 cells in a row."""
FEW = 64
"""So many numbers are ranked by comparing all with all; of more, the nearest are picked out first."""


class Candidates(NamedTuple):
    """Points among which neighbours are searched, in the order of their numbers, and scratch for their distances."""

    runs: Ints  # (27, 2) first point of a cell, and the one after its last
    near: Floats  # (3, room) coordinates
    number: Ints  # (room,)
    squared: Floats  # (room,) squared distances
    close: Floats  # (room,) those of the listed
    listed: Ints  # (room,) places of near ones
    ranks: Ints  # (room,)
    ordered: Floats  # (room,) squared distances of the nearest, the point itself first
    who: Ints  # (room,) their numbers


@part
def own_place(octant: int) -> int:
    """Place of a child of a cell among the 4 x 4 x 4 cells round all its children."""
    return 21 + 16 * (octant >> 2) + 4 * ((octant >> 1) & 1) + (octant & 1)


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
def divide(code: Codes, blocks: Ints, depth: int, place: int, start: Ints) -> None:
    """Write the 4 x 4 x 4 cells round a cell's eight children from the 3 x 3 x 3 cells round the cell itself."""
    for number in range(27):
        x, y, z = number // 9, number // 3 % 3, number % 3
        parent = place + AROUND[number]
        split(code, blocks[depth, parent, 0], blocks[depth, parent, 1], depth + 2, start)
        for octant in range(8):
            gx, gy, gz = 2 * x + (octant >> 2) - 1, 2 * y + ((octant >> 1) & 1) - 1, 2 * z + (octant & 1) - 1
            if min(gx, gy, gz) >= 0 and max(gx, gy, gz) <= 3:
                blocks[depth + 1, 16 * gx + 4 * gy + gz, 0] = start[octant]
                blocks[depth + 1, 16 * gx + 4 * gy + gz, 1] = start[octant + 1]


@part
def list_runs(blocks: Ints, depth: int, place: int, runs: Ints) -> tuple[int, int]:
    """List the runs of points in the 27 cells round a cell by number; return how many, and of how many points."""
    n_runs, total = 0, 0
    for step in AROUND:
        low, high = blocks[depth, place + step, 0], blocks[depth, place + step, 1]
        if high > low:
            at = n_runs
            while at > 0 and runs[at - 1, 0] > low:
                runs[at, 0], runs[at, 1] = runs[at - 1, 0], runs[at - 1, 1]
                at -= 1
            runs[at, 0], runs[at, 1] = low, high
            n_runs += 1
            total += high - low
    return n_runs, total


@part
def gather(xyz: Floats, found: Candidates, n_runs: int, low: int) -> int:
    """Copy the points of the runs side by side; return at which place point `low` is."""
    total, place = 0, 0
    for run in range(n_runs):
        if found.runs[run, 0] <= low:
            place = total + low - found.runs[run, 0]
        for j in range(found.runs[run, 0], found.runs[run, 1]):
            found.near[0, total] = xyz[j, 0]
            found.near[1, total] = xyz[j, 1]
            found.near[2, total] = xyz[j, 2]
            found.number[total] = j
            total += 1
    return place


@part
def insert(best: Floats, index: Ints, n_best: int, d2: float, j: int) -> int:
    """Put point `j` into a list sorted by distance and then number; return its length, at most the list's size."""
    size = len(best)
    if n_best == size:
        if d2 > best[size - 1] or (d2 == best[size - 1] and j > index[size - 1]):
            return size
        n_best = size - 1
    at = n_best
    while at > 0 and (d2 < best[at - 1] or (d2 == best[at - 1] and j < index[at - 1])):
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
def rank_nearest(
    xyz: Floats, i: int, found: Candidates, total: int, place: int, k: int, guess: float, bound: float
) -> int:
    """Rank the k nearest of `total` candidates to point i, none beyond the squared distance `bound`; return how many.

    `guess` is a smaller bound, taken if it holds enough; `place` is that of the point itself among the candidates.
    """
    near, squared, close, listed = found.near, found.squared, found.close, found.listed
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
    rank(close, n_near, found.ranks)
    for s in range(n_near):
        found.ordered[found.ranks[s]] = close[s]
        found.who[found.ranks[s]] = found.number[listed[s]]
    return min(n_near - 1, k)
