"""Planes round the cubes of space that hold points."""

from __future__ import annotations

from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

NEIGHBOURS = 24
"""Cells whose means make the plane of a cell, itself included."""
TRIED = (*combinations(range(1, 6), 2), *product((1, 3), (7, 10, 13, 17, 21)))
"""Pairs of neighbours, nearest first, through which and the cell planes are tried: near ones lie on the same of two
close surfaces, but on a scan line all of them lie on one line."""
SLAB, THINNEST = 0.12, 0.04
"""Half the thickness of a plane: by the distance of the last neighbour, and at least in metres."""
LEAST_SHARE = 0.45
"""Of the neighbours in the slab of a plane: beside a second surface it holds half of them."""
LEAST_SINE = 0.05
"""Of the angle at a place between two neighbours, below which all three are on a line."""
LEAST_WIDTH = 0.05
"""Middle variance by the largest: below it neighbours are one scan line, which lies in many planes."""
CHUNK = 20_000


class Planes(NamedTuple):
    """Unit normals (m, 3) of either sign of the planes round places, and where (m,) the neighbours make one at all."""

    normal: Floats
    flat: NDArray[np.bool_]


def mean_of(groups: NDArray[np.int64], n_groups: int, values: Floats) -> Floats:
    """Return the mean (m, 3) of values (n, 3) over groups (n,)."""
    counts = np.bincount(groups, minlength=n_groups)
    sums = np.stack([np.bincount(groups, column, n_groups) for column in values.T], axis=1)
    return np.asarray(sums / counts[:, None])


def planes_round(places: Floats) -> Planes:
    """Return the plane round each of the places (m, 3), which are means of the points of a cell.

    It is the plane through the place on which most of its `NEIGHBOURS` lie: beside another surface, such as the other
    side of a wall or the wall across a corner, one through all of them would be neither.
    """
    if len(places) < NEIGHBOURS:
        return Planes(np.tile([0.0, 0.0, 1.0], (len(places), 1)), np.zeros(len(places), bool))
    tree = cKDTree(places)
    normal, flat = np.empty_like(places), np.empty(len(places), bool)
    for first in range(0, len(places), CHUNK):
        rows = slice(first, first + CHUNK)
        distance, near = tree.query(places[rows], k=NEIGHBOURS)
        offset = places[near] - places[rows, None]
        normal[rows], flat[rows] = _planes(offset, np.maximum(SLAB * distance[:, -1], THINNEST))
    return Planes(normal, flat)


def _planes(offset: Floats, slab: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return normal (c, 3) and flatness (c,) from offsets (c, k, 3) to neighbours, nearest first, and slabs (c,)."""
    best, weight = np.zeros(len(offset), np.int64), np.zeros(offset.shape[:2], bool)
    # A plane after the other, in single precision: a tenth of the time of all at once.
    axes = np.ascontiguousarray(offset.transpose(2, 0, 1), np.float32)
    limit = slab.astype(np.float32)[:, None]
    for one, other in TRIED:
        x, y, z = _crossed(axes[:, :, one], axes[:, :, other])
        within = np.abs(x * axes[0] + y * axes[1] + z * axes[2]) < limit
        # Three places on a line make no plane: their normal is short, and within counts for nothing.
        counted = np.where((x * x + y * y + z * z)[:, 0] > 0.5, np.count_nonzero(within, axis=1), 0)
        better = counted > best
        best[better], weight[better] = counted[better], within[better]
    total = best.astype(np.float64)
    mean = np.einsum("ck,cki->ci", weight, offset) / np.maximum(total, 1.0)[:, None]
    apart = (offset - mean[:, None]) * weight[:, :, None]
    values, vectors = np.linalg.eigh(np.matmul(apart.transpose(0, 2, 1), apart))
    flat = (total >= LEAST_SHARE * offset.shape[1]) & (values[:, 1] > LEAST_WIDTH * values[:, 2])
    return vectors[:, :, 0], flat


def _crossed(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the unit normals (3, c, 1) of planes through the origin and two places (3, c); 0 where these line up."""
    cross = np.stack([one[k - 2] * other[k - 1] - one[k - 1] * other[k - 2] for k in range(3)])
    length = np.sqrt((cross * cross).sum(axis=0))
    arms = np.sqrt((one * one).sum(axis=0) * (other * other).sum(axis=0))
    good = length > LEAST_SINE * arms
    return np.asarray(np.where(good, cross / np.where(good, length, 1.0), 0.0)[:, :, None])
