"""Which regions of a map in tiles are one plane: decided for all tiles at once, by the sums of whole regions.

How well one plane does for two pieces of wall hangs on how much of either is seen. So a tile alone may unite what the
whole map keeps apart, or keep apart what is one. Tiles tell the regions that grew in them and which of these meet;
here regions that share points are added up, and those that meet are united by the rule of maps in memory
(:func:`mapq.segmentation.regions.merge`). Only tiles that had it otherwise are cut again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.regions import fit_regions
from mapq.scale.borders import Shared, unite_regions
from mapq.scale.cut import Cut, Decided, Pieces
from mapq.scale.moments import translate
from mapq.segmentation.regions import Fits, merge

FEWEST = 3
"""Own points over all tiles of a region that is known as a whole; else it is what its tile says."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Unions(NamedTuple):
    """What is one plane.

    Attributes
    ----------
    label : list of (r,) int64
        By tile, of each region that grew in it: regions of one label are one plane. -1: not known.
    decided : list of Decided or None
        By tile, what it is to be cut again with; None where it had it so.
    """

    label: list[Ints]
    decided: list[Decided | None]


def decide_unions(cuts: list[Cut], shared: Shared, max_rms: float) -> Unions:
    """Return which regions of all tiles are one plane.

    Parameters
    ----------
    cuts : list of Cut
        By tile.
    shared : Shared
        Pairs of regions, as they grew, of different tiles that share points.
    max_rms : float
        Metres that either may lie off a common plane, in the root mean square.
    """
    pieces = [cut.grown for cut in cuts]
    first = np.concatenate([[0], np.cumsum([len(each.parent) for each in pieces])]).astype(np.int64)
    origin, own, seen = (np.concatenate([getattr(each, name) for each in pieces]) for name in ("origin", "own", "seen"))
    pairs = np.column_stack([first[side[:, 0]] + side[:, 1] for side in (shared.one, shared.other)])
    same = unite_regions(origin, seen, own[:, 0] > 0.0, pairs, shared, max_rms)
    fits, group = add_up(same, origin, own)
    touching = np.concatenate([each.pairs + begin for each, begin in zip(pieces, first[:-1], strict=True)])
    touching = touching[(own[touching, 0] > 0.0).any(axis=1)]
    meeting = np.sort(group[touching], axis=1).astype(np.int32)
    meeting = np.unique(meeting[meeting[:, 0] != meeting[:, 1]], axis=0)
    into = merge(fits, meeting, max_rms)
    united, label = add_up(into, fits.origin, fits.sums)
    whole = np.where(united.sums[label[group], 0] >= FEWEST, label[group], -1)
    found = [
        _of_tile(each, whole[begin : begin + len(each.parent)]) for each, begin in zip(pieces, first, strict=False)
    ]
    decided = [
        None if _is_same(each, labels) else _decided(_apart(labels, each.parent), united.planes)
        for each, labels in zip(pieces, found, strict=True)
    ]
    return Unions(found, decided)


def add_up(parent: NDArray[np.int32], origin: Floats, own: Floats) -> tuple[Fits, Ints]:
    """Return the planes of united regions by the points that belong to each tile, and the group (r,) of each region.

    The origin is that of the group's first region with points.
    """
    roots, group = np.unique(parent, return_inverse=True)
    n_groups = len(roots)
    place = np.full(n_groups, len(parent), np.int64)
    with_points = np.flatnonzero(own[:, 0] > 0.0)
    np.minimum.at(place, group[with_points], with_points)
    place[place == len(parent)] = roots[place == len(parent)]
    to = np.ascontiguousarray(origin[place])
    moved = translate(own, origin, to[group])
    moved[own[:, 0] == 0.0] = 0.0
    columns = [np.bincount(group, column, n_groups) for column in moved.T]
    sums: Floats = np.column_stack(columns).astype(np.float64)
    planes, spread = np.empty((n_groups, 6)), np.empty((n_groups, 3))
    fit_regions(to, sums, planes, spread)
    return Fits(planes, spread, to, sums), group.astype(np.int64)


def _of_tile(pieces: Pieces, whole: Ints) -> Ints:
    """Return the label (r,) of each region of a tile.

    What only its halo shows has that of what the tile unites it with; of several, of what has the most points.
    """
    known = np.flatnonzero(whole >= 0)
    order = known[np.lexsort((-pieces.seen[known, 0], pieces.parent[known]))]
    roots, place = np.unique(pieces.parent[order], return_index=True)
    of_root = np.full(len(whole), -1, np.int64)
    of_root[roots] = whole[order[place]]
    return np.where(whole >= 0, whole, of_root[pieces.parent])


def _is_same(pieces: Pieces, label: Ints) -> bool:
    """Return whether a tile united its regions as they are labelled, as far as its own points have to do with it."""
    one = np.unique(pieces.parent, return_inverse=True)[1]
    other = np.unique(_apart(label, pieces.parent), return_inverse=True)[1]
    has_own = pieces.own[:, 0] > 0.0
    concerned = np.zeros(len(one), bool)
    for side in (one, other):
        concerned |= np.bincount(side, has_own, len(one))[side] > 0.0
    both = one[concerned] * (len(other) + 1) + other[concerned]
    counts = {len(np.unique(values)) for values in (one[concerned], other[concerned], both)}
    return len(counts) == 1


def _apart(label: Ints, parent: NDArray[np.int32]) -> Ints:
    """Return labels (r,) with others in the place of those not known: what the tile united stays so."""
    return np.where(label >= 0, label, -1 - parent.astype(np.int64))


def _decided(label: Ints, planes: Floats) -> Decided:
    """Return what a tile is cut again with."""
    _, first, group = np.unique(label, return_index=True, return_inverse=True)
    parent = first[group].astype(np.int32)
    known = np.full((len(label), 6), np.nan)
    known[label >= 0] = planes[label[label >= 0]]
    return Decided(parent, known)
