"""A short tour through all space of a roadmap: viewpoints, the ways between neighbouring ones, and their order."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from prf.simulate.roadmap import CELL, Roadmap
from prf.simulate.world import Floats

Ints = NDArray[np.int64]


class Ways(NamedTuple):
    """Ways between neighbouring viewpoints, those whose regions touch.

    Attributes
    ----------
    lengths : (k, k) sparse array
        Metres.
    crossing : dict
        For viewpoints (a, b) the two places at which the way leaves the region of a and enters that of b.
    predecessor : (n,) int32
        For each place of the roadmap the one before it, on the way from its viewpoint.
    """

    lengths: sparse.csr_array
    crossing: dict[tuple[int, int], tuple[int, int]]
    predecessor: NDArray[np.int32]

    def between(self, a: int, b: int) -> list[int]:
        """Return the places on the way from viewpoint a to its neighbour b, both ends included."""
        leave, enter = self.crossing[a, b]
        return [*reversed(self._back(leave)), *self._back(enter)]

    def _back(self, place: int) -> list[int]:
        """Return the places from one back to its viewpoint."""
        way = []
        while place >= 0:
            way.append(place)
            place = int(self.predecessor[place])
        return way


def viewpoints(road: Roadmap, reach: float) -> Ints:
    """Return places from which all others are at most `reach` metres of way, those with most space round them first."""
    covered = np.zeros(len(road.xy), dtype=np.bool_)
    chosen = []
    for place in np.argsort(-road.clearance, kind="stable").tolist():
        if not covered[place]:
            chosen.append(place)
            _cover(road, place, reach, covered)
    return np.array(chosen)


def _cover(road: Roadmap, place: int, reach: float, covered: NDArray[np.bool_]) -> None:
    """Mark all that is at most `reach` of way from a place; no such way leaves the rows of the grid so near to it."""
    y = road.xy[:, 1]
    low, high = np.searchsorted(y, [y[place] - reach - CELL, y[place] + reach + CELL])
    rows = road.steps[low:high, low:high]
    covered[low:high] |= csgraph.dijkstra(rows, indices=place - low, limit=reach) <= reach


def tour_places(road: Roadmap, stops: Ints, first: int) -> list[Ints]:
    """Return the legs of a tour: for each the places from one viewpoint to the next, both included.

    Parameters
    ----------
    road : Roadmap
    stops : (k,) int64
        Places to visit.
    first : int
        Which of them comes first.
    """
    ways = _ways(road, stops)
    lengths, before = csgraph.dijkstra(ways.lengths, return_predecessors=True)
    order = short_tour(lengths, first).tolist()
    legs = []
    for here, there in itertools.pairwise(order):
        hops = _hops(before[here], there)
        places = [place for a, b in itertools.pairwise(hops) for place in ways.between(a, b)]
        legs.append(np.array(places))
    return legs


def short_tour(lengths: Floats, first: int) -> Ints:
    """Return an order in which to visit all of k points: nearest neighbour first, then 2-opt; the end is free.

    Parameters
    ----------
    lengths : (k, k) float64
        Symmetric.
    first : int
        Where to begin.
    """
    order, left = [first], np.ones(len(lengths), dtype=np.bool_)
    left[first] = False
    while left.any():
        order.append(int(np.where(left, lengths[order[-1]], np.inf).argmin()))
        left[order[-1]] = False
    tour = np.array(order)
    while _turn_one_part(tour, lengths):
        pass
    return tour


def _turn_one_part(tour: Ints, lengths: Floats) -> bool:
    """Turn parts of a tour round where that makes it shorter, in place; return whether any did."""
    shorter = False
    for i in range(len(tour) - 2):
        a, b, ends = tour[i], tour[i + 1], tour[i + 2 :]
        after = np.r_[ends[1:], -1]
        joins = np.where(after >= 0, lengths[b, after] - lengths[ends, after], 0.0)
        gain = lengths[a, b] - lengths[a, ends] - joins
        best = int(gain.argmax())
        if gain[best] > 1e-9:
            tour[i + 1 : i + best + 3] = tour[i + 1 : i + best + 3][::-1].copy()
            shorter = True
    return shorter


def _ways(road: Roadmap, stops: Ints) -> Ways:
    """Return the shortest way between each two viewpoints whose regions touch."""
    distance, predecessor, source = csgraph.dijkstra(road.steps, indices=stops, min_only=True, return_predecessors=True)
    number = np.zeros(len(road.xy), dtype=np.int64)
    number[stops] = np.arange(len(stops))
    region = number[source]
    steps = road.steps.tocoo()
    apart = region[steps.row] != region[steps.col]
    leave, enter, length = steps.row[apart], steps.col[apart], steps.data[apart]
    whole = distance[leave] + length + distance[enter]
    pair = region[leave] * len(stops) + region[enter]
    by_length = np.lexsort((leave, whole, pair))
    _, at = np.unique(pair[by_length], return_index=True)
    best = by_length[at]
    a, b = region[leave[best]], region[enter[best]]
    lengths = sparse.csr_array((whole[best], (a, b)), (len(stops), len(stops)))
    ends = zip(leave[best].tolist(), enter[best].tolist(), strict=True)
    crossing = dict(zip(zip(a.tolist(), b.tolist(), strict=True), ends, strict=True))
    return Ways(lengths, crossing, predecessor)


def _hops(before: NDArray[np.int32], there: int) -> list[int]:
    """Return the viewpoints on the way to one of them."""
    hops = [there]
    while before[hops[-1]] >= 0:
        hops.append(int(before[hops[-1]]))
    return hops[::-1]
