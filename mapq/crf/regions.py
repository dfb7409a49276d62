"""Regions of a map, and folds of regions: neighbours must not be on both sides of a cross-validation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def split_regions(centroid: NDArray[np.float64], max_patches: int) -> NDArray[np.int64]:
    """Return the region (m,) of each patch: the map halved at medians across its longer side.

    `centroid` (m, 3): metres. `max_patches`: regions are halved until they have no more.
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
    """Return the fold (n,) of each patch: whole regions, dealt so that folds have alike many patches of either label.

    Regions are dealt largest first, each to the fold that has least of what the region has, the smallest of equals.

    `region` (n,): numbers from 0, each map's its own. `suspicious` (n,). `n_folds`: at most; fewer if there are fewer
    regions.
    """
    n_regions = int(region.max()) + 1 if len(region) else 0
    counts = np.column_stack([np.bincount(region[kind], minlength=n_regions) for kind in (suspicious, ~suspicious)])
    shares = counts / np.maximum(counts.sum(axis=0), 1)
    loads = np.zeros((max(1, min(n_folds, n_regions)), 2))
    fold_of = np.zeros(n_regions, np.int64)
    for index in np.lexsort((np.arange(n_regions), -shares.sum(axis=1))).tolist():
        overlap = np.round(loads @ shares[index], 12)
        fold = int(np.lexsort((np.arange(len(loads)), loads.sum(axis=1), overlap))[0])
        fold_of[index] = fold
        loads[fold] += shares[index]
    return fold_of[region]
