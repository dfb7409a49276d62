"""Voxels by number: keys, a hash table of their places, and the points of a cloud in them."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.sheets import Sheets

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


class Nearby(NamedTuple):
    """All points (n,) of a cloud, voxel after voxel."""

    points: Floats  # (n, 3)
    moment: Ints  # (n,) from 0
    patch: Ints  # (n,) -1 for none
    to_sensor: Floats  # (n, 3), zero where it is not known
    key: Ints  # (v,) of the voxels
    first: Ints  # (v + 1,) number of each voxel's first point
    table: Ints  # places of keys
    side: float  # metres


@part
def cell_over(sheets: Sheets, i: int, u: float, v: float) -> int:
    """Cell of patch i, from 0, at the place (u, v) of its plane; `EMPTY` where there are no points of it."""
    column = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i]))
    row = int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i]))
    if column < 0 or row < 0 or column >= sheets.size[i, 0] or row >= sheets.size[i, 1]:
        return EMPTY
    cell = row * sheets.size[i, 0] + column
    at = sheets.base[i] + cell
    return cell if sheets.first[at + 1] > sheets.first[at] else EMPTY


@part
def voxels_about(nearby: Nearby, points: Floats, begin: int, end: int, mark: int, marks: Ints, found: Ints) -> int:
    """Write the places of the voxels in which points of a patch lie, and of those beside; how many.

    A voxel is written once: `marks` (v,) remembers the number of the patch, `mark`, that did so last, twice that; one
    more where the voxels beside are written as well.
    """
    n, last = 0, EMPTY
    for k in range(begin, end):
        x = int(np.floor(points[k, 0] / nearby.side))
        y = int(np.floor(points[k, 1] / nearby.side))
        z = int(np.floor(points[k, 2] / nearby.side))
        here = key_of(x, y, z)
        if here == last:
            continue
        last = here
        own = find(nearby.key, nearby.table, here)
        if own != EMPTY and marks[own] == 2 * mark + 1:
            continue
        for number in range(27):
            beside = key_of(x + number % 3 - 1, y + number // 3 % 3 - 1, z + number // 9 - 1)
            place = find(nearby.key, nearby.table, beside)
            if place != EMPTY and marks[place] >> 1 != mark:
                marks[place] = 2 * mark
                found[n] = place
                n += 1
        if own != EMPTY:
            marks[own] = 2 * mark + 1
    return n
