"""Disagreement of scans where the right poses are known: how far the used poses put apart what is one surface.

An element of surface is a cell of the map seen from one side. That a wall seen from both sides is two surfaces, however
thin it is, keeps its two faces, 0.2 to 0.4 m apart, from being taken for one wall that is doubled.
"""

from __future__ import annotations

from itertools import combinations, pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from mapq.posed.merge import Merged, cell_keys

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


def mean_of(groups: NDArray[np.int64], n_groups: int, values: Floats) -> Floats:
    """Return the mean (m, 3) of values (n, 3) over groups (n,)."""
    counts = np.bincount(groups, minlength=n_groups)
    sums = np.stack([np.bincount(groups, column, n_groups) for column in values.T], axis=1)
    return np.asarray(sums / counts[:, None])


def planes_round(places: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return normals (m, 3) of either sign of the planes round places (m, 3), and which (m,) have a plane at all.

    Places are means of the points of a cell.

    It is the plane through the place on which most of its `NEIGHBOURS` lie: beside another surface, such as the other
    side of a wall or the wall across a corner, one through all of them would be neither.
    """
    if len(places) < NEIGHBOURS:
        return np.tile([0.0, 0.0, 1.0], (len(places), 1)), np.zeros(len(places), bool)
    tree = cKDTree(places)
    normal, flat = np.empty_like(places), np.empty(len(places), bool)
    for first in range(0, len(places), CHUNK):
        rows = slice(first, first + CHUNK)
        distance, near = tree.query(places[rows], k=NEIGHBOURS)
        offset = places[near] - places[rows, None]
        normal[rows], flat[rows] = _planes(offset, np.maximum(SLAB * distance[:, -1], THINNEST))
    return normal, flat


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


CELL, LARGEST_CELL = 0.4, 0.3
"""Side of the cells, by the reach; and at most, in metres, so that no cell holds more than one surface."""
PARALLEL = np.cos(np.radians(30.0))
"""Cosine between normals of what may be the same surface."""
TOLERANCE = 0.15
"""Metres off each other's plane of what may be the same surface: what good reference poses leave."""
FEWEST = 3
"""Points of a scan within reach of a surface that it sees."""
SAMPLE = 500
"""Points of each scan whose spacing is measured."""
REACHES = (0.4, 2.0)
"""Metres between which the reach is estimated."""
WIDE_SHARE = 0.9
REACH_IN_SPACING = 2.0


class Surfaces(NamedTuple):
    """Elements of surface, and the scans at each of them.

    Places and normals (m, 3) are in the frame of the map with the right poses; normals point to the sensors where those
    are known. `flat` (m,): the element has a plane. `at` and `by` (e,) are element and scan, of every scan that has a
    point in an element; `entry` (n,) is the row of each point there. `seen_at` and `seen_by` (s,), sorted by element,
    are of every scan that has `FEWEST` points on the surface within reach (metres).
    """

    place: Floats
    normal: Floats
    flat: NDArray[np.bool_]
    entry: NDArray[np.int64]
    at: NDArray[np.int64]
    by: NDArray[np.int64]
    seen_at: NDArray[np.int64]
    seen_by: NDArray[np.int64]
    reach: float


def find_surfaces(merged: Merged, poses: Floats, reach: float | None = None, sided: bool = True) -> Surfaces:
    """Return the surfaces of a map with the right poses (k, 4, 4).

    `reach` is how many metres along a surface two scans see the same part of it. None: twice the distance to the fourth
    neighbour in the same scan, that of the widest tenth, so that rings of a scan still meet; 0.4 to 2 m. `sided`: each
    scan was taken from one place, its origin; sub-maps were not.
    """
    reach = reach or estimate_reach(merged)
    points = merged.placed(poses)
    _, voxel = np.unique(cell_keys(points, min(CELL * reach, LARGEST_CELL)), return_inverse=True)
    means = mean_of(voxel, int(voxel.max()) + 1, points)
    normals, is_flat = planes_round(means)
    towards = np.einsum("ij,ij->i", poses[merged.scan, :3, 3] - points, normals[voxel])
    behind = (towards < 0.0) if sided else np.zeros(len(points), bool)
    found, element = np.unique(2 * voxel + behind, return_inverse=True)
    place = mean_of(element, len(found), points)
    normal = normals[found // 2] * np.where(found % 2, -1.0, 1.0)[:, None]
    flat = is_flat[found // 2]
    n_scans = len(poses)
    pairs, entry, counts = np.unique(element * n_scans + merged.scan, return_inverse=True, return_counts=True)
    at, by = pairs // n_scans, pairs % n_scans
    points_at = csr_array((counts, (at, by)), shape=(len(found), n_scans))
    near = _same_surface(place, normal, flat, reach, sided)
    seen = (near @ points_at + points_at).tocoo()
    enough = seen.data >= FEWEST
    order = np.lexsort((seen.col[enough], seen.row[enough]))
    seen_at, seen_by = seen.row[enough][order].astype(np.int64), seen.col[enough][order].astype(np.int64)
    return Surfaces(place, normal, flat, entry, at, by, seen_at, seen_by, reach)


def estimate_reach(merged: Merged) -> float:
    """Return the reach for the spacing of the points within their scans."""
    spacings = []
    starts = np.searchsorted(merged.scan, np.arange(int(merged.scan[-1]) + 2))
    for begin, end in pairwise(starts):
        points = merged.xyz[begin:end]
        if len(points) > FEWEST + 1:
            some = points[:: max(1, len(points) // SAMPLE)]
            spacings.append(cKDTree(points).query(some, k=FEWEST + 2)[0][:, -1])
    wide = float(np.quantile(np.concatenate(spacings), WIDE_SHARE)) if spacings else 0.0
    return float(np.clip(REACH_IN_SPACING * wide, *REACHES))


def _same_surface(place: Floats, normal: Floats, flat: NDArray[np.bool_], reach: float, sided: bool) -> csr_array:
    """Return the matrix (m, m) of the elements that continue each other: near, parallel, and in one plane.

    Elements without a plane continue those without one.
    """
    one, other = cKDTree(place).query_pairs(reach, output_type="ndarray").T
    cosine = np.einsum("ij,ij->i", normal[one], normal[other])
    apart = place[other] - place[one]
    off = np.maximum(
        np.abs(np.einsum("ij,ij->i", apart, normal[one])), np.abs(np.einsum("ij,ij->i", apart, normal[other]))
    )
    plane = flat[one] & flat[other] & ((cosine if sided else np.abs(cosine)) > PARALLEL) & (off < TOLERANCE)
    kept = plane | (~flat[one] & ~flat[other])
    one, other = one[kept], other[kept]
    rows, columns = np.concatenate([one, other]), np.concatenate([other, one])
    return csr_array((np.ones(len(rows), np.int64), (rows, columns)), shape=(len(place), len(place)))


def known_disagreement(
    surfaces: Surfaces, right: Floats, used: Floats, agree: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return how far apart the poses that are used put what is one place under the right poses.

    In metres (n,): the range of the scans that see the surface, along its normal: 0 where one scan alone saw it, nan
    where it is not known; and how many other scans (n,) are at the surface.

    At an element each scan b puts the place x of the right map at ``used_b inv(right_b) x``. The differences between
    scans are taken along the mean of the normal as the scans turn it: errors of poses, not of the whole frame.
    Elements without a plane have no normal; there the distance itself is a bound, which shows that scans agree where it
    is below `agree` metres, and nothing else.
    """
    moved = used @ np.linalg.inv(right)
    n_elements = len(surfaces.place)
    at, by = surfaces.seen_at, surfaces.seen_by
    normal = _mean_normal(surfaces, moved)
    # Rows of `at` that are not in `seen` compare themselves with those that are.
    low, high = np.full((n_elements, 3), np.inf), np.full((n_elements, 3), -np.inf)
    along_low, along_high = np.full(n_elements, np.inf), np.full(n_elements, -np.inf)
    seen_place = _put(moved, by, surfaces.place[at]) - surfaces.place[at]
    seen_along = np.einsum("ij,ij->i", seen_place, normal[at])
    np.minimum.at(low, at, seen_place)
    np.maximum.at(high, at, seen_place)
    np.minimum.at(along_low, at, seen_along)
    np.maximum.at(along_high, at, seen_along)
    at, by = surfaces.at, surfaces.by
    place = _put(moved, by, surfaces.place[at]) - surfaces.place[at]
    along = np.einsum("ij,ij->i", place, normal[at])
    # A scan that is alone in an element, or has too few points to count, still agrees with itself.
    metres = np.maximum(along, along_high[at]) - np.minimum(along, along_low[at])
    bound = np.linalg.norm(np.maximum(place, high[at]) - np.minimum(place, low[at]), axis=1)
    rough = np.where(bound < agree, bound, np.nan)
    n_seen = np.bincount(surfaces.seen_at, minlength=n_elements)[at]
    itself = np.isin(at * len(right) + by, surfaces.seen_at * len(right) + surfaces.seen_by)
    n_others = n_seen - itself
    value = np.where(n_others == 0, 0.0, np.where(surfaces.flat[at], metres, rough))
    return value[surfaces.entry], n_others[surfaces.entry]


def _put(moved: Floats, scan: NDArray[np.int64], place: Floats) -> Floats:
    """Return where scans (e,) put places (e, 3)."""
    return np.asarray(np.einsum("eij,ej->ei", moved[scan, :3, :3], place) + moved[scan, :3, 3])


def _mean_normal(surfaces: Surfaces, moved: Floats) -> Floats:
    """Return the unit normals (m, 3) as the scans at each element turn them, in the mean."""
    turned = np.einsum("eij,ej->ei", moved[surfaces.by, :3, :3], surfaces.normal[surfaces.at])
    total = np.stack([np.bincount(surfaces.at, column, len(surfaces.place)) for column in turned.T], axis=1)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None])
