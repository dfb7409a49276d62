"""Voxels by number: keys, and a hash table of their places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EMPTY = -1
MIX = 0x9E3779B97F4A7C15 - (1 << 64)
"""Odd number near 2^64 over the golden ratio, as a signed one: spreads keys over the table (Knuth)."""


@part
def key_of(x: int, y: int, z: int) -> int:
    """Number of a voxel; 21 bits an axis, enough for 40 km at 2 cm."""
    return ((x + 1048576) << 42) | ((y + 1048576) << 21) | (z + 1048576)


@part
def slot_of(key: int, n_slots: int) -> int:
    """First slot of the table, whose size is a power of two, at which to look for a key."""
    return ((key * MIX) >> 20) & (n_slots - 1)


@jit
def voxel_keys(points: Floats, side: float) -> Ints:
    """Key (n,) of the voxel of each point."""
    out = np.empty(len(points), np.int64)
    for k in range(len(points)):
        x, y, z = np.floor(points[k, 0] / side), np.floor(points[k, 1] / side), np.floor(points[k, 2] / side)
        out[k] = key_of(int(x), int(y), int(z))
    return out


@jit
def fill_table(key: Ints, table: Ints) -> None:
    """Enter the places of keys (v,) into a table that is at least twice as long, a power of two."""
    table[:] = EMPTY
    for place in range(len(key)):
        slot = slot_of(key[place], len(table))
        while table[slot] != EMPTY:
            slot = (slot + 1) & (len(table) - 1)
        table[slot] = place


@part
def find(key: Ints, table: Ints, wanted: int) -> int:
    """Place of a key among the keys of a table, or `EMPTY`."""
    slot = slot_of(wanted, len(table))
    while table[slot] != EMPTY:
        place = table[slot]
        if key[place] == wanted:
            return place
        slot = (slot + 1) & (len(table) - 1)
    return EMPTY
