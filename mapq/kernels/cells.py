"""Cells of an octree, as numbers: where a point lies along the Morton curve, and which points begin a new cell.

The curve visits each cell of each level in one go, so points sorted by their number lie together cell by cell, at
every size of cell at once. The root is a cube; level 0 is the root, and each level halves the side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part

LEVELS = 21
"""Of the finest cells: three times 21 bits fit into one number."""


@part
def spread_bits(index: int) -> np.uint64:
    """Put two zero bits after each of the 21 bits of a cell's index along one axis."""
    bits = np.uint64(index)
    bits = (bits | (bits << np.uint64(32))) & np.uint64(0x1F00000000FFFF)
    bits = (bits | (bits << np.uint64(16))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits << np.uint64(8))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits << np.uint64(4))) & np.uint64(0x10C30C30C30C30C3)
    return (bits | (bits << np.uint64(2))) & np.uint64(0x1249249249249249)


@part
def gather_bits(code: np.uint64) -> int:
    """Undo :func:`spread_bits`: collect every third bit."""
    bits = code & np.uint64(0x1249249249249249)
    bits = (bits | (bits >> np.uint64(2))) & np.uint64(0x10C30C30C30C30C3)
    bits = (bits | (bits >> np.uint64(4))) & np.uint64(0x100F00F00F00F00F)
    bits = (bits | (bits >> np.uint64(8))) & np.uint64(0x1F0000FF0000FF)
    bits = (bits | (bits >> np.uint64(16))) & np.uint64(0x1F00000000FFFF)
    return np.int64((bits | (bits >> np.uint64(32))) & np.uint64(0x1FFFFF))


@jit
def number_cells(xyz: NDArray[np.float64], low: NDArray[np.float64], side: float) -> NDArray[np.uint64]:
    """Return the Morton number (n,) of the finest cell of each point of the cube with corner `low`."""
    n_cells = 1 << LEVELS
    code = np.empty(len(xyz), np.uint64)
    for i in range(len(xyz)):
        number = np.uint64(0)
        for axis in range(3):
            index = np.int64((xyz[i, axis] - low[axis]) / side * n_cells)
            number = (number << np.uint64(1)) | spread_bits(min(max(index, 0), n_cells - 1))
        code[i] = number
    return code


@jit
def first_levels(code: NDArray[np.uint64]) -> NDArray[np.int8]:
    """Return for each point (n,) of a sorted curve the coarsest level at which it begins a cell.

    22 where the finest cell of the point before it goes on. The points that begin a cell of level l are those with a
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
