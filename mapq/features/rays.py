"""Free-space evidence: how much of a patch the rays of other passes go through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.provenance import Views
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.features.voxels import table_of
from mapq.kernels.rays import Voxels, count_rays
from mapq.kernels.voxels import voxel_keys

MOST_RAYS = 400_000
"""Rays that are followed; of more every so manieth."""
LEAST_RAYS = 2
"""Rays through a voxel that make it one that is seen through: a single one may be a mixed range."""
VOXEL = 0.25
"""Metres: side of the voxels, more where points are sparse."""
MARGIN = 1.5
"""Tolerances by which a ray must go on beyond a patch."""

Floats = NDArray[np.float64]


def seen_through(shapes: PatchShapes, views: Views | None, settings: FeatureSettings) -> Floats:
    """Return how far (m,) rays of other passes go through each patch, less what its own pass sees through; 0 unknown.

    Mean over its voxels of rays that go through in rays that go through or end there; of its own pass the share of the
    voxels that any go through. Where another pass saw through a wall there is none: the strongest sign of a misplaced
    one. Fences and panes are seen through by their own pass too, and what the others hit as well is there.
    """
    out = np.zeros(len(shapes))
    if views is None or not views.passes_known or not len(shapes.points):
        return out
    voxels, place = _voxels(shapes, views)
    known = np.flatnonzero(np.isfinite(views.to_sensor).all(axis=1))
    known = known[:: max(1, -(-len(known) // MOST_RAYS))]
    hit = np.ascontiguousarray(shapes.points[known])
    through = np.zeros((len(voxels.key), 2), np.int64)
    margin = MARGIN * shapes.tolerance(settings)
    count_rays(voxels, shapes.planes, hit + views.to_sensor[known], hit, views.seen_by[known], margin, through)
    ended = _ended(voxels, place[known], np.repeat(np.arange(len(shapes)), shapes.counts)[known], views.seen_by[known])
    is_seen = through >= LEAST_RAYS
    shares = is_seen[:, 0], is_seen[:, 1] * through[:, 1] / np.maximum(through[:, 1] + ended, 1)
    n_voxels = np.maximum(np.bincount(voxels.patch, minlength=len(shapes)), 1)
    own, others = (np.bincount(voxels.patch, share, len(shapes)) / n_voxels for share in shares)
    return np.asarray(np.maximum(others - own, 0.0))


def _ended(
    voxels: Voxels, place: NDArray[np.int64], patch: NDArray[np.int64], seen_by: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return how many rays (n,) of passes other than a voxel's own end in it on its patch."""
    counted = (patch == voxels.patch[place]) & (seen_by != voxels.seen_by[place])
    return np.bincount(place[counted], minlength=len(voxels.key))


def _voxels(shapes: PatchShapes, views: Views) -> tuple[Voxels, NDArray[np.int64]]:
    """Return the voxels that hold points, each with the patch and the pass of most of them, and that of each point.

    Points are put on their patch's plane first, where rays are tested: noise would part them among two layers.
    """
    side = max(VOXEL, 2.0 * float(np.median(shapes.spacing)))
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)
    normal = shapes.normal[patch]
    height = np.einsum("ij,ij->i", shapes.points - shapes.centre[patch], normal)
    key, place = np.unique(voxel_keys(shapes.points - height[:, None] * normal, side), return_inverse=True)
    n_passes = int(views.seen_by.max()) + 1
    owner, votes = np.unique(np.column_stack([place, patch * n_passes + views.seen_by]), axis=0, return_counts=True)
    order = np.lexsort((owner[:, 1], -votes, owner[:, 0]))
    first = order[np.unique(owner[order, 0], return_index=True)[1]]
    found = owner[first, 1]
    return Voxels(key, found // n_passes, found % n_passes, table_of(key), side), place
