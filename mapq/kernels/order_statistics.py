"""Order statistics: what percentiles need, without sorting."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import Floats, Ints, core, jit


@core
def part_by(values: NDArray[Any], low: int, high: int, pivot: float, keeps_equal: bool) -> int:
    """Move what is below a pivot, or equal to it too, to the front of ``values[low:high]``; return where that ends.

    Without a branch, which would be guessed wrong for every second value.
    """
    end = low
    for at in range(low, high):
        value = values[at]
        values[at] = values[end]
        values[end] = value
        end += not value > pivot if keeps_equal else value < pivot
    return end


@core
def select(values: NDArray[Any], n: int, k: int) -> float:
    """Value of rank k (from 0) among the first n (Hoare 1961); reorders them so that none before rank k is larger."""
    low, high = 0, n
    while high - low > 1:
        a, b, c = values[low], values[(low + high) // 2], values[high - 1]
        pivot = max(min(a, b), min(max(a, b), c))
        end = part_by(values, low, high, pivot, False)
        if k < end:
            high = end
            continue
        low = part_by(values, end, high, pivot, True)
        if k < low:
            return pivot
    return values[k]


@core
def quantile(values: Floats, n: int, share: float) -> float:
    """Quantile of the first n >= 1 values, linear between ranks (type 7 of Hyndman and Fan 1996); reorders them."""
    rank = share * (n - 1)
    k = min(int(rank), n - 1)
    below = select(values, n, k)
    if k + 1 >= n or rank == k:
        return below
    above = values[k + 1]
    for index in range(k + 2, n):
        above = min(above, values[index])
    return below + (rank - k) * (above - below)


@jit
def quantiles(values: Floats, start: Ints, share: float) -> Floats:
    """Quantile (m,) of each group ``values[start[i]:start[i + 1]]``; 0 for an empty one."""
    out = np.zeros(len(start) - 1)
    for i in range(len(out)):
        group = values[start[i] : start[i + 1]].copy()
        out[i] = quantile(group, len(group), share) if len(group) > 0 else 0.0
    return out
