"""Elements of surface of a map whose poses are right, and which scans see each of them.

An element is a cell of the map seen from one side. That a wall seen from both sides is two surfaces, however thin it
is, is what keeps its two faces, 0.2 to 0.4 m apart, from being taken for one wall that was drawn twice.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from mapq.perturb.cells import cell_keys, mean_of, planes_round
from mapq.perturb.merge import Merged

Floats = NDArray[np.float64]

GRAIN, WIDEST_GRAIN = 0.4, 0.3
"""Side of the cells, by the reach; and at most, in metres, lest one cell hold more than one surface."""
PARALLEL = np.cos(np.radians(30.0))
"""Cosine between normals of what may be the same surface."""
TOLERANCE = 0.15
"""Metres off each other's plane of what may be the same surface: what good reference poses leave."""
FEWEST = 3
"""Points of a scan within reach that show that it sees a surface."""
SAMPLE = 500
"""Points of each scan that are asked for their spacing."""
REACHES = (0.4, 2.0)
"""Metres between which the reach is estimated."""
WIDE_SHARE = 0.9
REACH_IN_SPACING = 2.0


class Surfaces(NamedTuple):
    """Elements of surface, and the scans at each of them.

    Attributes
    ----------
    place, normal : (m, 3) float64
        In the frame of the map with the right poses; normals point to the sensors where those are known.
    flat : (m,) bool
        Whether the element has a plane.
    entry : (n,) int64
        For each point the row of `at` and `by`.
    at, by : (e,) int64
        Element and scan, of every scan that has a point in an element.
    seen_at, seen_by : (s,) int64
        Element and scan, of every scan that has `FEWEST` points on the surface within reach. Sorted by element.
    reach : float
        Metres.
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
    """Return the surfaces of a map with the right poses.

    Parameters
    ----------
    merged : Merged
    poses : (k, 4, 4) float64
        The right ones.
    reach : float, optional
        Metres along a surface within which two scans see the same part of it. None: twice the distance to the fourth
        neighbour in the same scan, that of the widest tenth, so that rings of a scan still meet; 0.4 to 2 m.
    sided : bool
        Whether each scan was taken from one place, its origin; sub-maps were not.
    """
    reach = reach or estimate_reach(merged)
    points = merged.placed(poses)
    _, voxel = np.unique(cell_keys(points, min(GRAIN * reach, WIDEST_GRAIN)), return_inverse=True)
    means = mean_of(voxel, int(voxel.max()) + 1, points)
    planes = planes_round(means)
    towards = np.einsum("ij,ij->i", poses[merged.scan, :3, 3] - points, planes.normal[voxel])
    behind = (towards < 0.0) if sided else np.zeros(len(points), bool)
    found, element = np.unique(2 * voxel + behind, return_inverse=True)
    place = mean_of(element, len(found), points)
    normal = planes.normal[found // 2] * np.where(found % 2, -1.0, 1.0)[:, None]
    flat = planes.flat[found // 2]
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
