"""Where a robot can be, on a grid of space with clearance, and a short tour through all of it."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph
from shapely.geometry.base import BaseGeometry

from prf.shell.errors import InputError
from prf.simulate.world import Floats, World

CELL = 0.1  # metres. Half a robot's play in a doorway: a coarser grid would lose doors
PLAY = 0.02
"""Metres between robot and walls: a step between two cells cuts a corner by 0.01 m, and the arcs of a buffer run inside
the true ones."""
MAX_CELLS = 2_500_000
NEIGHBOURS = ((0, 1), (1, -1), (1, 0), (1, 1))  # half of the eight steps to a neighbour; the other half is the way back
Ints = NDArray[np.int64]


class Roadmap(NamedTuple):
    """The places a robot can reach from one another."""

    xy: Floats  # (n, 2) centres of cells, metres, row by row from the lowest y
    clearance: Floats  # (n,) metres from each centre to the nearest place where the robot cannot be, about
    steps: sparse.csr_array  # (n, n) metres between neighbours, both ways
    blocked: BaseGeometry  # where the centre of the robot must not be

    @property
    def area(self) -> float:
        """Return the area in which the centre of the robot can be, in square metres, about."""
        return len(self.xy) * CELL**2

    def clear(self, start: Floats, ends: Floats) -> NDArray[np.bool_]:
        """Return whether the straight ways from a point (2,) to points (n, 2) keep clear of everything."""
        ways = np.stack([np.broadcast_to(start, ends.shape), ends], axis=1)
        free: NDArray[np.bool_] = ~shapely.intersects(self.blocked, shapely.linestrings(ways))
        return free


def roadmap(world: World, radius: float) -> Roadmap:
    """Return the largest connected space for a robot.

    `radius`: of the robot, metres; it stays inside the window too.
    """
    window = world.window
    shape = tuple(max(1, int(length / CELL)) for length in (window.height, window.width))
    if shape[0] * shape[1] > MAX_CELLS:
        most = MAX_CELLS * CELL**2
        raise InputError(f"world of {window.area:.0f} m2: paths are planned in up to {most:.0f} m2. Give --path FILE.")
    blocked = _blocked(world, radius)
    xy = _centres(world, shape)
    free = ~shapely.contains_xy(blocked, xy) & window._replace(
        x_min=window.x_min + radius,
        y_min=window.y_min + radius,
        x_max=window.x_max - radius,
        y_max=window.y_max - radius,
    ).contains(xy)
    free = free.reshape(shape)
    part, n_parts = ndimage.label(free, np.ones((3, 3)))
    if n_parts == 0:
        raise InputError(
            f"no space for a robot of radius {radius:g} m. Give a smaller --set simulate.robot_radius=, or a --path."
        )
    kept = part == int(np.bincount(part.ravel())[1:].argmax()) + 1
    clearance = ndimage.distance_transform_edt(np.pad(kept, 1))[1:-1, 1:-1] * CELL
    places = kept.ravel()
    return Roadmap(xy[places], clearance.ravel()[places], _steps(kept, xy), blocked)


def _blocked(world: World, radius: float) -> BaseGeometry:
    """Return where the centre of the robot cannot be."""
    blocked = world.occupied.buffer(radius + PLAY, quad_segs=8)
    shapely.prepare(blocked)
    return blocked


def _centres(world: World, shape: tuple[int, ...]) -> Floats:
    n_y, n_x = shape
    window = world.window
    x = window.x_min + (np.arange(n_x) + 0.5) * window.width / n_x
    y = window.y_min + (np.arange(n_y) + 0.5) * window.height / n_y
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _steps(kept: NDArray[np.bool_], xy: Floats) -> sparse.csr_array:
    """Return the lengths of the steps between neighbouring places."""
    number = np.full(kept.shape, -1)
    number[kept] = np.arange(np.count_nonzero(kept))
    grid = np.pad(number, 1, constant_values=-1)
    n_y, n_x = kept.shape
    ones, others = [], []
    for down, right in NEIGHBOURS:
        other = grid[1 + down : 1 + down + n_y, 1 + right : 1 + right + n_x]
        joined = (number >= 0) & (other >= 0)
        ones.append(number[joined])
        others.append(other[joined])
    one, other = np.concatenate(ones), np.concatenate(others)
    places = xy[kept.ravel()]
    length = np.hypot(*(places[one] - places[other]).T)
    n = len(places)
    steps = sparse.coo_array((length, (one, other)), (n, n))
    return sparse.csr_array(steps + steps.T)


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

    `stops` (k,): places to visit. `first`: which of them is first.
    """
    neighbours, crossing, predecessor = _ways(road, stops)
    lengths, before = csgraph.dijkstra(neighbours, return_predecessors=True)
    order = short_tour(lengths, first).tolist()
    legs = []
    for here, there in itertools.pairwise(order):
        hops = _back(before[here], there)[::-1]
        places = []
        for pair in itertools.pairwise(hops):
            leave, enter = crossing[pair]
            places += [*reversed(_back(predecessor, leave)), *_back(predecessor, enter)]
        legs.append(np.array(places))
    return legs


def short_tour(lengths: Floats, first: int) -> Ints:
    """Return an order in which to visit all of k points: nearest neighbour first, then 2-opt; the end is free.

    `lengths` (k, k): symmetric. `first`: where to begin.
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


def _back(before: NDArray[np.int32], there: int) -> list[int]:
    """Return the places from one back to the first."""
    way = []
    while there >= 0:
        way.append(there)
        there = int(before[there])
    return way


def _ways(
    road: Roadmap, stops: Ints
) -> tuple[sparse.csr_array, dict[tuple[int, int], tuple[int, int]], NDArray[np.int32]]:
    """Return the shortest way between each two viewpoints whose regions touch.

    Its lengths (k, k) in metres; for viewpoints (a, b) the two places at which it leaves the region of a and enters
    that of b; and for each place of the roadmap (n,) the one before it, on the way from its viewpoint.
    """
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
    return lengths, crossing, predecessor
