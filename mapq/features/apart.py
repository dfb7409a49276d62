"""What lies over a patch and was seen when the patch was not: copies of it, whether they are patches or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.provenance import Moments
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.features.voxels import table_of
from mapq.kernels.apart import Near
from mapq.kernels.apart import seen_apart as measure
from mapq.kernels.voxels import voxel_keys
from mapq.patches import Patches

FARTHEST = 1.5
"""Metres off its plane up to which points lie over a patch."""
NEAREST = 2.0
"""Tolerances off its plane from which they do: less is noise, of the patch or of what is left of it."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def seen_apart(
    patches: Patches, shapes: PatchShapes, number: Ints, moments: Moments | None, settings: FeatureSettings
) -> Floats:
    """Return how many (m,) of the points on and over each patch lie over it and were seen apart, as a share; 0 unknown.

    Parameters
    ----------
    patches : Patches
    shapes : PatchShapes
    number : (n,) int64
        Which points of the cloud the moments are of, ascending: all finite ones.
    moments : Moments or None
    settings : FeatureSettings
    """
    nearest = NEAREST * shapes.tolerance(settings)
    if moments is None or not len(shapes.points) or nearest >= FARTHEST:
        return np.zeros(len(shapes))
    near = _near(patches, number, moments)
    own = moments.moment[np.searchsorted(number, shapes.number)]
    band = np.array([nearest, FARTHEST])
    found = measure(near, shapes.sheets, shapes.planes, shapes.points, shapes.start, own, band, moments.reach)
    return np.asarray(found)


def _near(patches: Patches, number: Ints, moments: Moments) -> Near:
    """Return points of the cloud in voxels as wide as anything over a patch may be off it."""
    points = np.ascontiguousarray(patches.cloud.xyz[number], np.float64)
    key = voxel_keys(points, FARTHEST)
    order = np.argsort(key, kind="stable")
    distinct, first = np.unique(key[order], return_index=True)
    patch = patches.patch[number[order]].astype(np.int64)
    first = np.append(first, len(order)).astype(np.int64)
    return Near(points[order], moments.moment[order], patch, distinct, first, table_of(distinct), FARTHEST)
