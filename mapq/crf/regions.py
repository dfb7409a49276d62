"""Regions of a map, and folds of regions: neighbours must not stand on both sides of a cross-validation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def split_regions(centroid: NDArray[np.float64], max_patches: int) -> NDArray[np.int64]:
    """Return the region (m,) of each patch: the map halved at medians across its longer side.

    Parameters
    ----------
    centroid : (m, 3) float64
        Metres.
    max_patches : int
        Regions are halved until they have no more.
    """
    region = np.zeros(len(centroid), np.int64)
    pending, n_regions = [np.arange(len(centroid))], 0
    while pending:
        members = pending.pop()
        if len(members) > max(max_patches, 1):
            spread = np.ptp(centroid[members], axis=0)
            order = members[np.argsort(centroid[members, int(spread.argmax())], kind="stable")]
            pending += [order[len(order) // 2 :], order[: len(order) // 2]]
            continue
        region[members] = n_regions
        n_regions += 1
    return region


def assign_folds(region: NDArray[np.int64], suspicious: NDArray[np.bool_], n_folds: int) -> NDArray[np.int64]:
    """Return the fold (n,) of each patch: whole regions, dealt so that folds get alike many suspicious patches.

    Parameters
    ----------
    region : (n,) int64
        Numbers from 0, each map's its own.
    suspicious : (n,) bool
    n_folds : int
        At most; fewer if there are fewer regions.
    """
    n_regions = int(region.max()) + 1 if len(region) else 0
    n_suspicious = np.bincount(region[suspicious], minlength=n_regions)
    n_patches = np.bincount(region, minlength=n_regions)
    loads = [[0, 0, fold] for fold in range(max(1, min(n_folds, n_regions)))]
    fold_of = np.zeros(n_regions, np.int64)
    for index in np.lexsort((np.arange(n_regions), -n_patches, -n_suspicious)).tolist():
        lightest = min(loads)
        fold_of[index] = lightest[2]
        lightest[0] += int(n_suspicious[index])
        lightest[1] += int(n_patches[index])
    return fold_of[region]
