"""Which patches are neighbours: the closest ones by their closest points (paper, section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.graph import PatchGraph
from mapq.kernels.closest import closest_patches, near_boxes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def find_neighbours(shapes: PatchShapes, settings: FeatureSettings) -> PatchGraph:
    """Join each patch to the closest ones within the radius.

    "The four closest plane patches to the current plane patch with respect to euclidean distance within a radius of s
    meters", by closest points and not by centroids; that of two patches one has the other among its closest is enough.
    Equally close ones are taken largest first, then by their place.
    """
    n_patches = len(shapes)
    trees = shapes.trees
    filled = np.flatnonzero(shapes.counts > 0)
    low, high = trees.low[trees.root[filled]], trees.high[trees.root[filled]]
    candidates = near_boxes(low, high, np.argsort(low[:, 0], kind="stable"), settings.radius)
    candidates = candidates[np.argsort(_gaps(low, high, candidates), kind="stable")]
    pairs = filled[candidates]
    distance, middle = closest_patches(trees, pairs, settings.n_neighbours, settings.radius)
    known = np.isfinite(distance)
    pairs, distance, middle = pairs[known], distance[known], middle[known]
    kept = closest_of_each(pairs, distance, shapes.size_rank, settings.n_neighbours)
    kept = kept[np.lexsort((pairs[kept, 1], pairs[kept, 0]))]
    return PatchGraph(n_patches, pairs[kept].astype(np.int32), distance[kept], middle[kept])


def closest_of_each(pairs: Ints, distance: Floats, rank: Ints, n_neighbours: int) -> Ints:
    """Return which pairs (n, 2) are among the closest of either of their patches, each once."""
    one = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.lexsort((rank[other], np.tile(distance, 2), one))
    sorted_one = one[order]
    place = np.arange(len(order)) - np.searchsorted(sorted_one, sorted_one)
    return np.unique(order[place < n_neighbours] % max(len(pairs), 1))


def _gaps(low: Floats, high: Floats, pairs: Ints) -> Floats:
    """Return the squared distance (n,) between the boxes of each pair."""
    i, j = pairs[:, 0], pairs[:, 1]
    apart = np.maximum(np.maximum(low[i] - high[j], low[j] - high[i]), 0.0)
    return np.asarray((apart * apart).sum(axis=1))
