"""The nearest of a set of candidates to a point: by ranking all at once, or by a sorted list that takes one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import part
from mapq.kernels.order import select

FEW = 64
"""So many numbers are ranked by comparing all with all; of more, the nearest are picked out first."""


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
def list_within(squared: NDArray[np.float64], total: int, bound: float, listed: NDArray[np.int64]) -> int:
    """List the places of squared distances up to a bound, without a branch; return how many."""
    n_near = 0
    for c in range(total):
        listed[n_near] = c
        n_near += squared[c] <= bound
    return n_near


@part
def rank(close: NDArray[np.float64], n: int, ranks: NDArray[np.int64]) -> None:
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
    xyz: NDArray[np.float64],
    i: int,
    guess: float,
    bound: float,
    near: NDArray[np.float64],
    number: NDArray[np.int64],
    total: int,
    place: int,
    squared: NDArray[np.float64],
    close: NDArray[np.float64],
    listed: NDArray[np.int64],
    ranks: NDArray[np.int64],
    ordered: NDArray[np.float64],
    who: NDArray[np.int64],
    k: int,
) -> int:
    """Rank the k nearest of the candidates to point i, none beyond the squared distance `bound`; return how many.

    `guess` is a smaller bound, taken if it holds enough; `place` tells which of the candidates the point itself is. It
    comes first in `ordered` and `who`, which hold squared distances and numbers. Candidates come in the order of their
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
