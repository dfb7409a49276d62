"""Which regions of neighbouring tiles are one patch: those that share points that both see, and lie in one plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.merging import pair_rms, resolve, unite
from mapq.scale.cut import border_path

FAIR_SHARE = 0.5
"""Of the points that both tiles see of the smaller region: so many must be of the other region too."""
FEWEST_SHARED = 3
"""Points that two regions must share at least."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class BorderTask(NamedTuple):
    """A tile, the tiles of higher number that it may share points with, the work folder, and which regions are meant.

    Those are ``region``, or ``grown``: as they grew, before pieces of one plane were united.
    """

    tile: int
    others: tuple[int, ...]
    folder: str
    column: str = "region"


class Shared(NamedTuple):
    """Pairs of regions that share points.

    Attributes
    ----------
    one, other : (k, 2) int64
        Tile and region.
    n_shared : (k,) int64
        Points that are of both.
    n_one, n_other : (k,) int64
        Points of each that both tiles see.
    """

    one: Ints
    other: Ints
    n_shared: Ints
    n_one: Ints
    n_other: Ints


def compare_borders(task: BorderTask) -> Shared:
    """Return which regions of a tile and of its neighbours share points, and how many."""
    return join_shared([_compare(task, other) for other in task.others])


def join_shared(parts: list[Shared]) -> Shared:
    """Return the pairs of all parts."""
    nothing = np.zeros((0, 2), np.int64)
    empty = Shared(nothing, nothing, *(np.zeros(0, np.int64),) * 3)
    return Shared(*(np.concatenate(values) for values in zip(*[empty, *parts], strict=True)))


def _compare(task: BorderTask, other: int) -> Shared:
    tile, column = task.tile, task.column
    with np.load(border_path(task.folder, tile)) as mine, np.load(border_path(task.folder, other)) as theirs:
        _, here, there = np.intersect1d(mine["number"], theirs["number"], assume_unique=True, return_indices=True)
        a, b = mine[column][here].astype(np.int64), theirs[column][there].astype(np.int64)
    n_a, n_b = np.bincount(a[a >= 0], minlength=1), np.bincount(b[b >= 0], minlength=1)
    both = (a >= 0) & (b >= 0)
    key, n_shared = np.unique(a[both] * len(n_b) + b[both], return_counts=True)
    first, second = key // len(n_b), key % len(n_b)
    return Shared(
        np.column_stack([np.full(len(first), tile), first]),
        np.column_stack([np.full(len(second), other), second]),
        n_shared.astype(np.int64),
        n_a[first].astype(np.int64),
        n_b[second].astype(np.int64),
    )


def unite_regions(
    origin: Floats, seen: Floats, pairs: Ints, shared: Shared, max_rms: float, label: Ints | None = None
) -> NDArray[np.int32]:
    """Return into which region (m,) each goes, over all tiles.

    Pairs (k, 2) that share a fair part of what both tiles see of the smaller one are united, best fits first, as long
    as one plane does for both: neither lies farther off it than `max_rms`, in the root mean square. Before these go the
    pairs that are known to be of one plane.

    Parameters
    ----------
    origin, seen : (m, 3), (m, 10) float64
        Moments of the regions of all tiles, halo included.
    pairs : (k, 2) int64
        Numbers among these regions.
    shared : Shared
        What is known of the pairs.
    max_rms : float
        Metres.
    label : (m,) int64, optional
        Regions of one label lie in one plane; -1 where that is not known.
    """
    smaller = np.minimum(shared.n_one, shared.n_other)
    fair = (shared.n_shared >= FEWEST_SHARED) & (shared.n_shared >= FAIR_SHARE * smaller)
    parent = np.arange(len(seen), dtype=np.int32)
    sums = seen.copy()
    some = np.ascontiguousarray(pairs[fair].astype(np.int32))
    known = np.zeros(len(some), bool)
    if label is not None:
        known = (label[some[:, 0]] == label[some[:, 1]]) & (label[some[:, 0]] >= 0)
    for which, limit in ((known, np.inf), (~known, max_rms)):
        _unite(np.ascontiguousarray(some[which]), parent, origin, sums, limit)
    resolve(parent)
    return parent


def _unite(pairs: NDArray[np.int32], parent: NDArray[np.int32], origin: Floats, sums: Floats, max_rms: float) -> None:
    """Unite pairs (k, 2) in place, best fits first."""
    rms = pair_rms(pairs, parent, origin, sums)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], rms))
    order = order[rms[order] <= max_rms]
    unite(np.ascontiguousarray(pairs[order]), parent, origin, sums, max_rms)
