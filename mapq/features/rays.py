"""Free-space evidence: how much of a patch the rays of other passes go through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.provenance import Views
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.features.voxels import table_of
from mapq.kernels.rays import GRAZING, Voxels, count_rays
from mapq.kernels.voxels import voxel_keys

MOST_RAYS = 400_000
"""Rays that are followed; of more every n-th."""
LEAST_RAYS = 2
"""Rays through a voxel that make it one that is seen through: a single one may be a mixed range."""
VOXEL = 0.25
"""Metres: side of the voxels, more where points are sparse."""
MARGIN = 1.5
"""Tolerances by which a ray must go on beyond a patch."""

Floats = NDArray[np.float64]


class Rays(NamedTuple):
    """Rays (r) that are followed, from sensors to points of patches.

    Attributes
    ----------
    sensor, hit : (r, 3) float64
    seen_by : (r,) float64
        Pass of each, as the field has it.
    patch : (r,) int64
        Whose point each hits; -1 for one that is not at hand.
    """

    sensor: Floats
    hit: Floats
    seen_by: Floats
    patch: NDArray[np.int64]


def draw_rays(shapes: PatchShapes, views: Views) -> Rays:
    """Return the rays that are followed: of all patches one after the other, every n-th."""
    known = np.flatnonzero(has_ray(views.to_sensor))
    return take_rays(shapes, views, known[:: ray_step(len(known))])


def ray_step(n_rays: int) -> int:
    """Return of how many rays one is followed."""
    return max(1, -(-n_rays // MOST_RAYS))


def has_ray(to_sensor: Floats) -> NDArray[np.bool_]:
    """Return of which points (k,) it is known where the sensor was."""
    return np.asarray(np.isfinite(to_sensor).all(axis=1))


def take_rays(shapes: PatchShapes, views: Views, some: NDArray[np.int64]) -> Rays:
    """Return the rays to some of the points of patches (k,)."""
    hit = np.ascontiguousarray(shapes.points[some])
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)[some]
    return Rays(hit + views.to_sensor[some], hit, views.seen_by[some], patch)


def voxel_side(spacing: Floats) -> float:
    """Return the side of the voxels in metres, for the spacings (m,) of all patches of a map."""
    return max(VOXEL, 2.0 * float(np.median(spacing)))


def seen_through(
    shapes: PatchShapes,
    views: Views | None,
    settings: FeatureSettings,
    rays: Rays | None = None,
    side: float | None = None,
) -> Floats:
    """Return how far (m,) rays of other passes go through each patch, less what its own pass sees through; 0 unknown.

    Mean over its voxels of rays that go through in rays that go through or end there; of its own pass the share of the
    voxels that any go through. Where another pass saw through a wall there is none: the strongest sign of a misplaced
    one. Fences and panes are seen through by their own pass too, and what the others hit as well is there.

    Parameters
    ----------
    shapes : PatchShapes
    views : Views or None
        Of the points of the patches.
    settings : FeatureSettings
    rays : Rays, optional
        Those of the whole map, where the patches are a part of it; as those are that come near.
    side : float, optional
        Of its voxels, in metres.
    """
    out = np.zeros(len(shapes))
    if views is None or not len(shapes.points):
        return out
    rays = draw_rays(shapes, views) if rays is None else rays
    distinct, number = np.unique(np.concatenate([views.seen_by, rays.seen_by]), return_inverse=True)
    seen_by, ray_by = np.split(number.astype(np.int64), [len(views.seen_by)])
    voxels = _voxels(shapes, seen_by, len(distinct), voxel_side(shapes.spacing) if side is None else side)
    through = np.zeros((len(voxels.key), 2), np.int64)
    margin = MARGIN * shapes.tolerance(settings)
    count_rays(voxels, shapes.planes, rays.sensor, rays.hit, ray_by, margin, through)
    ended = _ended(voxels, shapes, rays, ray_by)
    is_seen = through >= LEAST_RAYS
    shares = is_seen[:, 0], is_seen[:, 1] * through[:, 1] / np.maximum(through[:, 1] + ended, 1)
    n_voxels = np.maximum(np.bincount(voxels.patch, minlength=len(shapes)), 1)
    own, others = (np.bincount(voxels.patch, share, len(shapes)) / n_voxels for share in shares)
    return np.asarray(np.maximum(others - own, 0.0))


def seen_side(shapes: PatchShapes, to_sensor: Floats | None) -> Floats:
    """Return from which side (m,) each patch was seen: 1 where its normal points, -1 behind; nan unknown.

    The mean over its points, whose ways to the sensor (k, 3) may be nan; rays that graze the patch do not count.
    """
    if to_sensor is None:
        return np.full(len(shapes), np.nan)
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)
    height = np.einsum("ij,ij->i", to_sensor, shapes.normal[patch])
    steep = np.abs(height) > GRAZING * np.linalg.norm(to_sensor, axis=1)
    sums, counts = (
        np.bincount(patch[steep], each, len(shapes)) for each in (np.sign(height[steep]), np.ones(steep.sum()))
    )
    return np.asarray(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan))


def _ended(voxels: Voxels, shapes: PatchShapes, rays: Rays, ray_by: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many rays (v,) of passes other than a voxel's own end in it on its patch."""
    some = rays.patch >= 0
    patch = rays.patch[some]
    key = voxel_keys(_on_plane(shapes, rays.hit[some], patch), voxels.side)
    place = np.minimum(np.searchsorted(voxels.key, key), len(voxels.key) - 1)
    counted = (voxels.key[place] == key) & (patch == voxels.patch[place]) & (ray_by[some] != voxels.seen_by[place])
    return np.bincount(place[counted], minlength=len(voxels.key))


def _voxels(shapes: PatchShapes, seen_by: NDArray[np.int64], n_passes: int, side: float) -> Voxels:
    """Return the voxels that hold points, each with the patch and the pass of most of them.

    Points are put on their patch's plane first, where rays are tested: noise would part them among two layers.
    """
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)
    key, place = np.unique(voxel_keys(_on_plane(shapes, shapes.points, patch), side), return_inverse=True)
    owner, votes = np.unique(np.column_stack([place, patch * n_passes + seen_by]), axis=0, return_counts=True)
    order = np.lexsort((owner[:, 1], -votes, owner[:, 0]))
    first = order[np.unique(owner[order, 0], return_index=True)[1]]
    found = owner[first, 1]
    return Voxels(key, found // n_passes, found % n_passes, table_of(key), side)


def _on_plane(shapes: PatchShapes, points: Floats, patch: NDArray[np.int64]) -> Floats:
    """Return points (k, 3) dropped onto the planes of their patches (k,)."""
    normal = shapes.normal[patch]
    height = np.einsum("ij,ij->i", points - shapes.centre[patch], normal)
    return np.asarray(points - height[:, None] * normal)
