"""Blocks of 27 cells of the octree round a cell, as runs of points that are sorted along the Morton curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import part
from mapq.kernels.cells import LEVELS


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
def order_block(blocks: NDArray[np.int64], depth: int, px: int, py: int, pz: int, runs: NDArray[np.int64]) -> int:
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
def gather_block(
    xyz: NDArray[np.float64],
    runs: NDArray[np.int64],
    n_runs: int,
    low: int,
    near: NDArray[np.float64],
    number: NDArray[np.int64],
) -> tuple[int, int]:
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
