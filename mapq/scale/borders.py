"""Which regions of neighbouring tiles are one patch: those that share points that both see, and lie in one plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.merging import pair_rms, resolve, unite
from mapq.scale.tile_files import border_path

FAIR_SHARE = 0.5
"""Of the points that both tiles see of the smaller region: so many must be of the other region too."""
NEARLY_ALL = 0.9
"""Of the points of a region in a halo that must be of one region of another tile, to tell what that one meets."""
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
    origin: Floats,
    seen: Floats,
    has_own: NDArray[np.bool_],
    pairs: Ints,
    shared: Shared,
    max_rms: float,
    label: Ints | None = None,
) -> NDArray[np.int32]:
    """Return into which region (m,) each goes, over all tiles.

    Pairs (k, 2) that share a fair part of what both tiles see of the smaller one are united, best fits first, as long
    as one plane does for both: neither lies farther off it than `max_rms`, in the root mean square. Before these go the
    pairs that are known to be of one plane; others must be of both regions the one that shares the most. What only the
    halo of a tile shows unites nothing, as others see it better; it goes with the one of these that nearly all of its
    points are of.

    Parameters
    ----------
    origin, seen : (m, 3), (m, 10) float64
        Moments of the regions of all tiles, halo included.
    has_own : (m,) bool
        Which of them have points that belong to their tile.
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
    fair &= has_own[pairs].all(axis=1)
    known = np.zeros(len(pairs), bool)
    if label is not None:
        known = (label[pairs[:, 0]] == label[pairs[:, 1]]) & (label[pairs[:, 0]] >= 0)
    for which, limit in ((fair & known, np.inf), (fair & ~known & best_of_both(shared), max_rms)):
        _unite(np.ascontiguousarray(pairs[which].astype(np.int32)), parent, origin, sums, limit)
    _follow(parent, has_own, pairs, shared)
    resolve(parent)
    return parent


def best_of_both(shared: Shared) -> NDArray[np.bool_]:
    """Return of which pairs (k,) neither region has another of that tile with which it shares more points.

    A region that grew over two walls where a tile saw little of them would else make one of both. Pieces that one tile
    has and another has not are united like all that meet.
    """
    best = np.ones(len(shared.n_shared), bool)
    for mine, theirs in ((shared.one, shared.other), (shared.other, shared.one)):
        order = np.lexsort((theirs[:, 1], -shared.n_shared, theirs[:, 0], mine[:, 1], mine[:, 0]))
        key = np.column_stack([mine, theirs[:, :1]])[order]
        begins = np.ones(len(order), bool)
        begins[1:] = (key[1:] != key[:-1]).any(axis=1)
        best[order[~begins]] = False
    return best


def _follow(parent: NDArray[np.int32], has_own: NDArray[np.bool_], pairs: Ints, shared: Shared) -> None:
    """Have regions without points of their own go, in place, with those that nearly all of their points are of."""
    halo, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    n_shared, n_halo = np.tile(shared.n_shared, 2), np.concatenate([shared.n_one, shared.n_other])
    usable = ~has_own[halo] & has_own[other] & (n_shared >= FEWEST_SHARED) & (n_shared >= NEARLY_ALL * n_halo)
    halo, other, n_shared = halo[usable], other[usable], n_shared[usable]
    order = np.lexsort((other, -n_shared, halo))
    some, first = np.unique(halo[order], return_index=True)
    parent[some] = other[order[first]]


def _unite(pairs: NDArray[np.int32], parent: NDArray[np.int32], origin: Floats, sums: Floats, max_rms: float) -> None:
    """Unite pairs (k, 2) in place, best fits first."""
    rms = pair_rms(pairs, parent, origin, sums)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], rms))
    order = order[rms[order] <= max_rms]
    unite(np.ascontiguousarray(pairs[order]), parent, origin, sums, max_rms)
