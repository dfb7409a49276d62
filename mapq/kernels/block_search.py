"""Blocks of 27 cells of an octree around a cell, and the nearest of the points in them."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Codes, Floats, Floats32, Ints, Ints32, core
from mapq.kernels.cells import LEVELS
from mapq.kernels.order_statistics import select

AROUND = np.array([16 * x + 4 * y + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)])
"""Steps from a cell to the 27 round it, among 4 x 4 x 4 cells in a row."""
_CELLS = np.indices((4, 4, 4)).reshape(3, 64) + 1
_PARENTS = AROUND.reshape(3, 3, 3)[tuple(_CELLS // 2)]
CHILDREN = np.column_stack([_PARENTS, np.array([4, 2, 1]) @ (_CELLS % 2), np.arange(64)])[np.argsort(_PARENTS)]
"""Of the 4 x 4 x 4 cells round a cell's children, parent by parent: the step to the parent, the octant, the place."""
FEW = 64
"""Of so many sorted numbers all are looked at to find where eight cells begin, and so many candidates are ranked by
comparing all with all; of more, borders are found by halving, and the nearest are picked out first."""
PLACES = 2048
"""Room for candidates: their places are the low bits of keys."""
ROUNDING = -PLACES
"""The other bits: of a squared distance in single precision."""
WIDTH = 32
"""Lists are padded to multiples of it (:func:`padded`)."""


class Candidates(NamedTuple):
    """Points among which neighbours are searched, and scratch for their distances; all but `runs` have `PLACES`."""

    runs: Ints  # (28, 2) first point of a cell, and the one after its last
    near: Floats  # (3, PLACES) coordinates
    number: Ints  # of the points
    squared: Floats  # squared distances
    rounded: Floats32  # the same
    key: Ints32  # their bits (the same memory), with the place of the candidate in the low ones
    listed: Ints32  # keys of near ones
    ordered: Floats  # squared distances of the nearest, the point itself first
    who: Ints  # their numbers


@core
def own_place(octant: int) -> int:
    """Place of a child of a cell among the 4 x 4 x 4 cells round all its children."""
    return 21 + 16 * (octant >> 2) + 4 * ((octant >> 1) & 1) + (octant & 1)


@core
def split(code: Codes, low: int, high: int, level: int, start: Ints) -> None:
    """Write where the eight cells of `level` begin among the points low to high - 1 of their parent."""
    shift = np.uint64(3 * (LEVELS - level))
    for octant in range(9):
        start[octant] = low
    if high - low <= FEW:
        for j in range(low, high):
            start[np.int64((code[j] >> shift) & np.uint64(7)) + 1] = j + 1
        for octant in range(1, 9):
            start[octant] = max(start[octant], start[octant - 1])
        return
    begin = low
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


@core
def divide(code: Codes, blocks: Ints, depth: int, place: int, start: Ints) -> None:
    """Write the 4 x 4 x 4 cells round a cell's eight children from the 3 x 3 x 3 cells round the cell itself."""
    last = -1
    for row in range(len(CHILDREN)):
        parent, octant, child = place + CHILDREN[row, 0], CHILDREN[row, 1], CHILDREN[row, 2]
        if parent != last:
            split(code, blocks[depth, parent, 0], blocks[depth, parent, 1], depth + 2, start)
            last = parent
        blocks[depth + 1, child, 0], blocks[depth + 1, child, 1] = start[octant], start[octant + 1]


@core
def list_runs(blocks: Ints, depth: int, place: int, runs: Ints) -> tuple[int, int]:
    """List the runs of points in the 27 cells round a cell; return how many, and of how many points."""
    n_runs, total = 0, 0
    for step in range(len(AROUND)):
        low, high = blocks[depth, place + AROUND[step], 0], blocks[depth, place + AROUND[step], 1]
        runs[n_runs, 0], runs[n_runs, 1] = low, high
        n_runs += high > low
        total += high - low
    return n_runs, total


@core
def padded(n: int, width: int) -> int:
    """Round up to a multiple of a width: of what vector instructions take at once, so that none are left over."""
    return (n + width - 1) // width * width


@core
def gather(xyz: Floats, found: Candidates, n_runs: int, low: int) -> int:
    """Copy the points of the runs side by side; return at which place point `low` is.

    Unsigned numbers of places, here and below, as signed ones could count from the end, which takes time to tell.
    """
    near, total, place = found.near, 0, 0
    for run in range(n_runs):
        begin, end = found.runs[run, 0], found.runs[run, 1]
        if begin <= low < end:
            place = total + low - begin
        for j in range(begin, end):
            point, c = np.uint64(j), np.uint64(total)
            near[0, c], near[1, c], near[2, c] = xyz[point, 0], xyz[point, 1], xyz[point, 2]
            found.number[c] = j
            total += 1
    for after in range(total, padded(total, WIDTH)):
        near[0, after] = near[1, after] = near[2, after] = np.inf
    return place


@core
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


@core
def list_within(key: Ints32, total: int, bound: int, listed: Ints32) -> int:
    """List the keys up to a bound, without a branch; return how many."""
    n_near, end = 0, np.uint32(bound + 1)
    for c in range(total):
        listed[np.uint64(n_near)] = key[c]
        n_near += int(np.uint32(key[c]) < end)
    return n_near


@core
def key_of(found: Candidates, squared: float) -> int:
    """Return the largest key that a squared distance may have."""
    found.rounded[PLACES - 1] = squared
    return int(found.key[PLACES - 1]) | (PLACES - 1)


@core
def sort_keys(listed: Ints32, n: int, key: Ints32) -> None:
    """Write the first n of some distinct keys in ascending order.

    Every key is compared with every other: for a few dozen that is faster than sorting, as it is done by vector
    instructions and never guesses a branch.
    """
    full = padded(n, WIDTH)
    for s in range(n, full):
        listed[s] = np.iinfo(np.int32).max
    for t in range(n):
        rank = np.int32(0)
        for s in range(full):
            rank = np.int32(rank + np.int32(listed[s] < listed[t]))
        key[np.uint64(rank)] = listed[t]


@core
def write_keys(xyz: Floats, i: int, found: Candidates, total: int, place: int) -> None:
    """Write the distances of the candidates from point i, which is at `place` among them, and their keys."""
    near, squared, rounded, key = found.near, found.squared, found.rounded, found.key
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    full = padded(total, WIDTH)
    for c in range(full):
        dx, dy, dz = near[0, c] - x, near[1, c] - y, near[2, c] - z
        squared[c] = dx * dx + dy * dy + dz * dz
    for c in range(full):
        rounded[c] = np.float32(squared[c])
    for c in range(full):
        key[c] = (key[c] & ROUNDING) | c
    squared[place], key[place] = -1.0, place


@core
def rank_nearest(
    xyz: Floats, i: int, found: Candidates, total: int, place: int, k: int, guess: float, bound: float
) -> int:
    """Rank the k nearest of `total` candidates to point i, none far beyond a squared distance; return how many.

    `guess` is a smaller bound, taken if it holds enough; `place` is that of the point itself among the candidates.
    Rounded distances sort all but those that are nearly equal, which are put right one by one.
    """
    key, listed = found.key, found.listed
    write_keys(xyz, i, found, total, place)
    n_near = list_within(key, total, key_of(found, min(guess, bound)), listed)
    if n_near <= k and guess < bound:
        n_near = list_within(key, total, key_of(found, bound), listed)
    if n_near > max(FEW, 2 * k):
        n_near = list_within(key, total, int(select(listed, n_near, k)) | (PLACES - 1), listed)
    sort_keys(listed, n_near, key)
    ordered, who, last = found.ordered, found.who, -np.inf
    for s in range(n_near):
        c = np.uint64(key[s] & (PLACES - 1))
        last, before = found.squared[c], last
        if last > before:
            ordered[s], who[s] = last, found.number[c]
        else:
            insert(ordered, who, s, last, found.number[c])
            last = ordered[s]
    return min(n_near - 1, k)
