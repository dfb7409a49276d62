"""Which points of a cloud a page shows: evenly spread in space, so that walls look whole wherever the sensor stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

N_ROUNDS = 12
"""Sizes of cells that are tried at most; each try is a sort."""
CLOSE_ENOUGH = 0.8
"""Share of the points allowed that is no longer worth another try."""
LOOKED_AT = 4_000_000
"""Points that cells are made of; of more, evenly spaced ones."""

_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64)
"""Multipliers that spread cells over 64 bits."""


def evenly(xyz: NDArray[np.float64], group: NDArray[np.int32], n_most: int) -> NDArray[np.intp]:
    """Return the numbers of at most `n_most` points, ascending: the first of each group in each cell of a grid.

    Parameters
    ----------
    xyz : (n, 3) float64
        Finite.
    group : (n,) int32
        Patch of each point. Of small patches points remain as long as there are fewer patches than `n_most`.
    n_most : int
    """
    if len(xyz) <= n_most:
        return np.arange(len(xyz))
    some = np.arange(0, len(xyz), -(-len(xyz) // LOOKED_AT))
    places = xyz[some] - xyz[some].min(axis=0)
    size = float(places.max()) / 500.0 or 1.0
    best = np.zeros(0, np.intp)
    for _ in range(N_ROUNDS):
        found = _firsts(places, group[some], size)
        if len(found) <= n_most and len(found) > len(best):
            best = found
        if CLOSE_ENOUGH * n_most <= len(found) <= n_most or len(found) == len(some):
            break
        # Points lie on surfaces, so there are as many cells as 1 / size².
        size *= float(np.sqrt(len(found) / (0.93 * n_most)))
    if len(best) == 0:
        best = np.arange(0, len(some), -(-len(some) // n_most))
    return np.sort(some[best])


def _firsts(places: NDArray[np.float64], group: NDArray[np.int32], size: float) -> NDArray[np.intp]:
    """Return the first point of every group in every cell of a grid; two cells may by rare chance pass for one."""
    cell = np.floor(places / size).astype(np.int64).astype(np.uint64)
    with np.errstate(over="ignore"):
        key = cell @ _ODD[:3] + group.astype(np.int64).astype(np.uint64) * _ODD[3]
        key ^= key >> np.uint64(29)
    return np.unique(key, return_index=True)[1]
