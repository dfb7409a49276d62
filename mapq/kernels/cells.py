"""Cells of an octree, as numbers: where a point lies along the Morton curve, and which points begin a new cell.

The curve visits each cell of each level in one go, so points sorted by their number lie together cell by cell, at
every size of cell at once. The root is a cube; level 0 is the root, and each level halves the side.
"""

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import Codes, Floats, Ints, Ints32, core, jit

LEVELS = 21
"""Of the finest cells: three times 21 bits fit into one number."""
DIGIT = 11
"""Bits of a number by which it is sorted at a time."""


@core
def spread_bits(index: int) -> np.uint64:
    """Put two zero bits after each of the 21 bits of a cell's index along one axis."""
    bits = np.uint64(index)
    bits = (bits | (bits << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    bits = (bits | (bits << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)


@core
def gather_bits(code: np.uint64) -> int:
    """Undo :func:`spread_bits`: collect every third bit."""
    bits = code & np.uint64(0x1249249249249249)
    bits = (bits | (bits >> np.uint64(2))) & np.uint64(0x10C30C30C30C30C3)
    bits = (bits | (bits >> np.uint64(4))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits >> np.uint64(8))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits >> np.uint64(16))) & np.uint64(0x1F00000000FFFF)
    return int((bits | (bits >> np.uint64(32))) & np.uint64(0x1FFFFF))


@jit
def find_bounds(xyz: Floats) -> Floats:
    """Return the lowest and the highest coordinates (2, 3); ten times as fast as numpy along the long axis."""
    bounds = np.empty((2, 3))
    bounds[0], bounds[1] = np.inf, -np.inf
    for i in range(len(xyz)):
        for axis in range(3):
            bounds[0, axis] = min(bounds[0, axis], xyz[i, axis])
            bounds[1, axis] = max(bounds[1, axis], xyz[i, axis])
    return bounds


@jit
def number_cells(xyz: Floats, low: Floats, side: float) -> Codes:
    """Return the Morton number (n,) of the finest cell of each point of the cube with corner `low`."""
    n_cells = 1 << LEVELS
    code = np.empty(len(xyz), np.uint64)
    for i in range(len(xyz)):
        number = np.uint64(0)
        for axis in range(3):
            index = int((xyz[i, axis] - low[axis]) / side * n_cells)
            number = (number << np.uint64(1)) | spread_bits(min(max(index, 0), n_cells - 1))
        code[i] = number
    return code


@jit
def sort_codes(code: Codes) -> tuple[Codes, Ints32]:
    """Return numbers (n,) in ascending order and the place that each had, of equal ones in their order (radix sort)."""
    n, n_digits, mask = len(code), (3 * LEVELS + DIGIT - 1) // DIGIT, np.uint64((1 << DIGIT) - 1)
    start = np.zeros((n_digits, 1 << DIGIT), np.int64)
    for i in range(n):
        for digit in range(n_digits):
            start[digit, (code[i] >> np.uint64(DIGIT * digit)) & mask] += 1
    order, moved_order = np.arange(n).astype(np.int32), np.empty(n, np.int32)
    ordered, moved = code.copy(), np.empty_like(code)
    for digit in range(n_digits):
        first, total = start[digit], 0
        if first.max() == n:
            continue
        for value in range(len(first)):
            total, first[value] = total + first[value], total
        for i in range(n):
            value = (ordered[i] >> np.uint64(DIGIT * digit)) & mask
            at = np.uint64(first[value])
            first[value] += 1
            moved[at], moved_order[at] = ordered[i], order[i]
        ordered, moved, order, moved_order = moved, ordered, moved_order, order
    return ordered, order


@jit
def first_levels(code: Codes) -> NDArray[np.int8]:
    """Return for each point (n,) of a sorted curve the coarsest level at which it begins a cell.

    22 where the finest cell of the point before it continues. The points that begin a cell of level l are those with a
    value of at most l: one a cell, the same for every order in which the points came.
    """
    first = np.zeros(len(code), np.int8)
    for i in range(1, len(code)):
        differing = code[i] ^ code[i - 1]
        level = LEVELS + 1
        while differing != np.uint64(0):
            differing >>= np.uint64(3)
            level -= 1
        first[i] = level
    return first


@jit
def pick_one_a_cell(code: Codes, first_level: NDArray[np.int8], level: int) -> Ints:
    """Return one point of each cell of a level, in order.

    Which one is drawn by a hash of the cell's number (the finaliser of SplitMix64, Steele 2014): the first one would
    always lie in the same corner, and of two surfaces in a cell always be on the same.
    """
    n_cells = 0
    for i in range(len(code)):
        n_cells += first_level[i] <= level
    picked = np.empty(n_cells, np.int64)
    shift = np.uint64(3 * max(LEVELS - level, 0))
    start, at = 0, 0
    for end in range(1, len(code) + 1):
        if end < len(code) and first_level[end] > level:
            continue
        bits = (code[start] >> shift) + np.uint64(0x9E3779B97F4A7C15)
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        bits ^= bits >> np.uint64(31)
        picked[at] = start + np.int64(bits % np.uint64(end - start))
        at += 1
        start = end
    return picked
