"""How far apart the scans that see each patch truly lie, of poses that are right: `mapq` measures it without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.axes import TO_SENSOR
from mapq.labels import FROM_FIELD, FROM_NOBODY, UNLABELLED
from mapq.patches import Patches

FEWEST = 10
"""Points of its own that a scan needs on a patch to count."""
REACH = 0.3
"""Metres along the surface within which points of other scans are on it."""
OFF = 0.08
"""Metres off the patch's plane in the right map, at least."""
MOST = 4_000
"""Points of a patch that say where it is."""

Floats = NDArray[np.float64]


def true_ranges(patches: Patches, places: Floats, moved: Floats) -> Floats:
    """Return the range (m,) of the offsets of scans along each patch's normal, in metres; nan where one scan sees it.

    Of the scans that have `FEWEST` points on the surface in the right map, seen from the side of the patch. Of curved
    patches it is the largest along any normal.

    Parameters
    ----------
    patches : Patches
        Of a map with the field `scan`.
    places : (n, 3) array
        Where its points are in the right map.
    moved : (k, 4, 4) array
        What the poses used do to each scan of the right map.
    """
    scan, tree = np.asarray(patches.cloud.fields["scan"]).astype(np.int64), cKDTree(places)
    ways = None
    if set(TO_SENSOR) <= set(patches.cloud.fields):
        ways = np.column_stack([np.asarray(patches.cloud.fields[name], np.float64) for name in TO_SENSOR])
    points, start = patches.members
    found = np.full(len(patches), np.nan)
    bend = np.zeros_like(patches.normal) if patches.bend is None else patches.bend
    facing: Floats
    for patch, normal in enumerate(patches.normal):
        own = points[start[patch] : start[patch + 1]]
        if bend[patch].any():
            near, facing = _on_cylinder(places, tree, own, bend[patch])
            normals = facing[np.isin(near, own)]
        else:
            near = _on_surface(places, tree, own, normal)
            facing = normals = normal[None]
        if ways is not None:
            away = np.einsum("ij,ij->i", ways[near], np.broadcast_to(facing, (len(near), 3)))
            side = np.sign(away[np.isin(near, own)]).sum()
            near = near[away * side >= 0.0]
        counts = np.bincount(scan[near], minlength=len(moved))
        seen = np.flatnonzero(counts >= FEWEST)
        if len(seen) > 1:
            sums = np.stack([np.bincount(scan[near], axis, len(moved)) for axis in places[near].T], axis=1)
            mean = sums[seen] / counts[seen, None]
            offsets = np.einsum("kij,kj->ki", moved[seen, :3, :3], mean) + moved[seen, :3, 3] - mean
            found[patch] = np.ptp(offsets @ normals.T, axis=0).max()
    return found


def with_metres(patches: Patches, apart: Floats) -> Patches:
    """Return the patches labelled by how far apart they truly are (m,), in metres; nan: no label."""
    known = np.isfinite(apart)
    label = np.where(known, apart > patches.label_tolerance, UNLABELLED).astype(np.uint8)
    source = np.where(known, FROM_FIELD, FROM_NOBODY).astype(np.uint8)
    return replace(patches, apart=apart, label=label, label_source=source)


def _beside(places: Floats, tree: cKDTree, some: Floats) -> NDArray[np.int64]:
    """Return which points lie near some places (k, 3) of a patch, ascending."""
    cells = REACH * (np.unique(np.floor(some / REACH), axis=0) + 0.5)
    return np.unique(np.concatenate(tree.query_ball_point(cells, REACH)).astype(np.int64))


def _on_cylinder(
    places: Floats, tree: cKDTree, own: NDArray[np.int64], bend: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """Return which points lie on the cylinder of a patch's own points in the right map, and its normals (k, 3) there.

    Its circle is that of least squares of squared radii, across the axis of the patch.
    """
    axis = bend / np.linalg.norm(bend)
    across = np.linalg.svd(axis[None])[2][1:]
    some = places[own[:: 1 + len(own) // MOST]]
    middle = some.mean(axis=0)
    x, y = across @ (some - middle).T
    a, b, c = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None)[0]
    near = _beside(places, tree, some)
    ray = (places[near] - middle) @ across.T - 0.5 * np.array([a, b])
    away, radius = np.linalg.norm(ray, axis=1), np.sqrt(c + 0.25 * (a * a + b * b))
    on = np.abs(away - radius) < OFF
    return near[on], (ray[on] / away[on, None]) @ across


def _on_surface(places: Floats, tree: cKDTree, own: NDArray[np.int64], normal: Floats) -> NDArray[np.int64]:
    """Return which points lie on the surface of a patch's own points, in the right map."""
    some = places[own[:: 1 + len(own) // MOST]]
    middle = some.mean(axis=0)
    _, spread, axes = np.linalg.svd(some - middle, full_matrices=False)
    near = _beside(places, tree, some)
    off = max(OFF, 3.0 * float(spread[2]) / np.sqrt(len(some)))
    return np.asarray(near[np.abs((places[near] - middle) @ axes[2]) < off])
