"""Which patches are neighbours: the closest ones by their closest points (paper, section 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.graph import PatchGraph
from mapq.kernels.box_trees import closest_patches, near_boxes

MOST_PAIRS = 1_000_000
"""Pairs of boxes that are looked at in one go: 16 bytes each, and as much again for what is measured."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def find_neighbours(shapes: PatchShapes, settings: FeatureSettings, own: NDArray[np.bool_] | None = None) -> PatchGraph:
    """Join each patch (with a mask: each of those) to the closest ones within the radius.

    "The four closest plane patches to the current plane patch with respect to euclidean distance within a radius of s
    meters", by closest points and not by centroids; that of two patches one has the other among its closest is enough.
    Equally close ones are taken largest first, then by their place. In the safe reading those watched for conflicts
    are returned as well, which only measuring them can show.
    """
    n_watched = settings.n_watched if settings.reading == "safe" else 0
    pairs, distance, middle = measure_candidates(shapes, settings, max(settings.n_neighbours, n_watched))
    watched = closest_of_each(pairs, distance, shapes.size_rank, max(settings.n_neighbours, n_watched), own)
    close = np.zeros(len(pairs), np.bool_)
    close[closest_of_each(pairs, distance, shapes.size_rank, settings.n_neighbours, own)] = True
    kept = watched[np.lexsort((pairs[watched, 1], pairs[watched, 0]))]
    return PatchGraph(len(shapes), pairs[kept].astype(np.int32), distance[kept], middle[kept], close[kept])


def take_pairs(graph: PatchGraph, some: NDArray[np.bool_]) -> PatchGraph:
    """Return the graph with some of its pairs (a mask)."""
    _, pairs, separation, middle, close = graph
    return PatchGraph(graph.n_patches, pairs[some], separation[some], middle[some], close[some])


def measure_candidates(shapes: PatchShapes, settings: FeatureSettings, n_closest: int) -> tuple[Ints, Floats, Floats]:
    """Return pairs (n, 2), distance (n,) and middle (n, 3) of their closest points; all `n_closest` are there."""
    trees = shapes.trees
    low, high = trees.low[trees.root], trees.high[trees.root]
    nearest = np.full((len(shapes), n_closest), settings.radius**2)
    order = np.argsort(low[:, 0], kind="stable")
    found, place = [(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros((0, 3)))], 0
    while place < len(order):
        pairs, place = near_boxes(low, high, order, place, nearest, settings.radius, MOST_PAIRS)
        pairs = pairs[np.argsort(_gaps(low, high, pairs), kind="stable")]
        distance, middle = closest_patches(trees, pairs, nearest)
        known = np.isfinite(distance)
        found.append((pairs[known], distance[known], middle[known]))
    pairs, distance, middle = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return pairs, distance, middle


def closest_of_each(
    pairs: Ints, distance: Floats, rank: Ints, n_neighbours: int, own: NDArray[np.bool_] | None = None
) -> Ints:
    """Return which pairs (n, 2) are among the closest of either of their patches (of those in a mask), each once."""
    one = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.lexsort((rank[other], np.tile(distance, 2), one))
    if own is not None:
        order = order[own[one[order]]]
    sorted_one = one[order]
    place = np.arange(len(order)) - np.searchsorted(sorted_one, sorted_one)
    return np.unique(order[place < n_neighbours] % max(len(pairs), 1))


def _gaps(low: Floats, high: Floats, pairs: Ints) -> Floats:
    """Return the squared distance (n,) between the boxes of each pair."""
    i, j = pairs[:, 0], pairs[:, 1]
    apart = np.maximum(np.maximum(low[i] - high[j], low[j] - high[i]), 0.0)
    return np.asarray((apart * apart).sum(axis=1))
