"""A map cut into patches tile by tile: each tile is segmented with its halo, and regions are united across borders."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.segmentation import FEWEST_POINTS, Joined, Regions, cut_points, describe_regions, join_regions
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import sort_in_frame
from mapq.tiled.tiling import Tiling, WorkFolder

FAIR_SHARE = 0.5
"""Of the points of the smaller region that both tiles see: the share in the other region if the two meet."""
FEWEST_SHARED = 3
"""Points that two regions must share."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class TileRegions(NamedTuple):
    """The regions (r) of a tile by its own points."""

    regions: Regions
    low: Floats  # (r, 3) box of the points
    high: Floats  # (r, 3)
    # (r + 2,) where the points of each region begin in the tile's file of points, those of none, and where these end
    start: Ints
    n_points: int
    n_distinct: int
    n_looked_at: int


class Whole(NamedTuple):
    """The patches (m) of a map in tiles, in the map's own axes, and where their points are."""

    joined: Joined
    low: Floats  # (m, 3) box of the points
    high: Floats  # (m, 3)
    first: Ints  # (m + 1,) slices of patch i are ``slices[first[i]:first[i + 1]]``
    slices: Ints  # (s, 4) tile, begin, end and step in its file of points, of patches and of what is in none
    rest: Ints  # (q, 4)

    def __len__(self) -> int:
        """Return the number of patches."""
        return len(self.low)

    @property
    def corner(self) -> Floats:
        """Lowest corner (3,) of the box around all patches; 0 without any."""
        return self.low.min(axis=0) if len(self.low) else np.zeros(3)


def cut_tile(
    tile: int, store: WorkFolder, tiling: Tiling, halo: float, chosen: Parameters, frame: Floats, near: Floats
) -> TileRegions:
    """Segment a tile with its halo, and write its points region after region, and those that other tiles see.

    `halo`: metres. `frame` (4,): corner and side of the octree of the whole map. `near` (2, 3): box of the map; points
    beyond it are left out.
    """
    own = _inside(store.spooled(tile), near)
    around = [_inside(store.spooled(other), near) for other in tiling.neighbours(tile, halo).tolist()]
    records = np.concatenate([own, *(each[tiling.near(each["xyz"], tile, halo)] for each in around)])
    points = sort_in_frame(np.ascontiguousarray(records["xyz"]), frame)
    copies = np.bincount(points.number[: len(own)], minlength=len(points.xyz))
    region, curved, n_looked_at = np.full(len(points.xyz), -1, np.int32), np.zeros((0, 10)), 0
    if len(points.xyz) >= FEWEST_POINTS:
        region, curved, core = cut_points(points, chosen)
        n_looked_at = int(np.count_nonzero(copies[core.place]))
    of_point = region[points.number]
    shared = ~tiling.near(records["xyz"], tile, -halo)
    shared[len(own) :] = True
    _write_border(store.path("border", tile), records["number"][shared], of_point[shared])
    regions = describe_regions(points, region, copies, curved, chosen)
    n_regions = len(regions.origin)
    place = np.where(of_point[: len(own)] < 0, n_regions, of_point[: len(own)])
    order = np.argsort(place, kind="stable")
    store.write_points(tile, own[order])
    start = np.searchsorted(place[order], np.arange(n_regions + 2))
    low, high = np.full((n_regions, 3), np.inf), np.full((n_regions, 3), -np.inf)
    some = np.flatnonzero(np.diff(start[:-1]))
    if len(some):
        xyz = own["xyz"][order[: start[-2]]]
        low[some], high[some] = (each.reduceat(xyz, start[some]) for each in (np.minimum, np.maximum))
    return TileRegions(regions, low, high, start, len(own), int(np.count_nonzero(copies)), n_looked_at)


def _inside(records: NDArray[np.void], near: Floats) -> NDArray[np.void]:
    inside: NDArray[np.void] = records[((records["xyz"] >= near[0]) & (records["xyz"] <= near[1])).all(axis=1)]
    return inside


def _write_border(path: str, number: Ints, region: NDArray[np.int32]) -> None:
    """Write number and region of the points that other tiles see too, by number."""
    order = np.argsort(number)
    with open(path, "wb") as stream:
        np.save(stream, np.column_stack([number[order], region[order]]))


def unite(cuts: list[TileRegions], store: WorkFolder, tiling: Tiling, halo: float, chosen: Parameters) -> Whole:
    """Return the patches of all tiles."""
    first = np.cumsum([0, *(len(cut.regions.origin) for cut in cuts)])
    pairs = [np.zeros((0, 2), np.int64)]
    for tile in range(len(cuts)):
        mine = np.load(store.path("border", tile))
        for other in tiling.neighbours(tile, halo).tolist():
            if other > tile:
                pairs.append(shared_pairs(mine, np.load(store.path("border", other))) + first[[tile, other]])
    joined = join_regions([cut.regions for cut in cuts], np.concatenate(pairs), chosen)
    return _located(cuts, joined)


def shared_pairs(mine: Ints, theirs: Ints) -> Ints:
    """Return the pairs (k, 2) of regions of two tiles that hold a fair share of the same points.

    Points are rows (n, 2): number, ascending, and region, -1 for none.
    """
    _, here, there = np.intersect1d(mine[:, 0], theirs[:, 0], assume_unique=True, return_indices=True)
    a, b = mine[here, 1], theirs[there, 1]
    n_a, n_b = (np.bincount(each[each >= 0], minlength=1) for each in (a, b))
    both = (a >= 0) & (b >= 0)
    key, n_shared = np.unique(a[both] * len(n_b) + b[both], return_counts=True)
    one, other = np.divmod(key, len(n_b))
    fair = (n_shared >= FEWEST_SHARED) & (n_shared >= FAIR_SHARE * np.minimum(n_a[one], n_b[other]))
    return np.column_stack([one, other])[fair]


def _located(cuts: list[TileRegions], joined: Joined) -> Whole:
    """Return the patches with their boxes and the slices of their points."""
    n_patches = len(joined.normal)
    rows, numbers = [], []
    low, high = np.full((n_patches + 1, 3), np.inf), np.full((n_patches + 1, 3), -np.inf)
    for tile, (cut, number) in enumerate(zip(cuts, joined.number, strict=True)):
        n_rows = len(number)
        rows.append(np.column_stack([np.full(n_rows, tile), cut.start[:-1], cut.start[1:], np.ones(n_rows, np.int64)]))
        numbers.append(number)
        np.minimum.at(low, number[:-1], cut.low)
        np.maximum.at(high, number[:-1], cut.high)
    slices, of_patch = np.concatenate(rows), np.concatenate(numbers)
    is_there = slices[:, 2] > slices[:, 1]
    slices, of_patch = slices[is_there], of_patch[is_there]
    order = np.argsort(of_patch, kind="stable")
    first = np.searchsorted(of_patch[order], np.arange(n_patches + 1))
    rest, ordered = slices[order[: first[0]]], slices[order[first[0] :]]
    return Whole(joined, low[:-1], high[:-1], first - first[0], ordered, rest)
