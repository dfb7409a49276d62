"""Pairs of neighbours: which patches are joined, and how they lie to one another (equations 9 to 13)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.kernels.box_trees import closest_patches, near_boxes
from mapq.kernels.crossing import crossings
from mapq.kernels.overlap import overlaps

MOST_PAIRS = 1_000_000
"""Pairs of boxes that are looked at in one go: 16 bytes each, and as much again for what is measured."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class PatchGraph(NamedTuple):
    """The neighbourhood of the random field."""

    n_patches: int
    pairs: NDArray[np.int32]  # (n_pairs, 2) each pair of neighbours once, the smaller number first, in ascending order
    # (n_pairs,) shortest distance between the points of the two patches, in metres (rho of equation 9)
    separation: NDArray[np.float64]
    middle: NDArray[np.float64]  # (n_pairs, 3) middle of the closest points of the two patches
    # (n_pairs,) whether one is among the closest neighbours of the other, and not only among those watched for
    # conflicts
    close: NDArray[np.bool_]


def find_neighbours(shapes: PatchShapes, settings: FeatureSettings, own: NDArray[np.bool_] | None = None) -> PatchGraph:
    """Join each patch (with a mask: each of those) to the closest ones within the radius.

    "The four closest plane patches to the current plane patch with respect to euclidean distance within a radius of s
    meters", by closest points and not by centroids; that of two patches one has the other among its closest is enough.
    Equally close ones are taken largest first, then by their place. Those watched for conflicts are
    returned as well, which only measuring them can show.
    """
    n_watched = max(settings.neighbours, settings.watched)
    pairs, distance, middle = measure_candidates(shapes, settings, n_watched)
    watched = closest_of_each(pairs, distance, shapes.size_rank, n_watched, own)
    close = np.zeros(len(pairs), np.bool_)
    close[closest_of_each(pairs, distance, shapes.size_rank, settings.neighbours, own)] = True
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


EDGE_NAMES = ("separation", "weight", "overlap", "crossing", "angle_deg", "offset", "overlap_area")


def edge_features(shapes: PatchShapes, graph: PatchGraph, settings: FeatureSettings) -> tuple[Floats, Floats]:
    """Return the features (n, 7) named by `EDGE_NAMES`, and x_ij (n,).

    separation (equation 9): distance of the closest points less the spacing of points, not below 0, in metres.
    weight (equation 10): W = exp(-separation / tau).
    overlap (equation 11): A, the area of either that the other covers at an offset beyond the tolerance, over the area
    of the smaller one; see :func:`mapq.kernels.overlap.overlaps`.
    crossing (equation 12): R, how centrally they cross; see :func:`mapq.kernels.crossing.crossings`.
    angle_deg, offset, overlap_area: acute angle of the planes in degrees, median distance of the planes over the shared
    area in metres, and that area in m².
    x_ij = 1 - W (A + R) (equation 13), in [-1, 1]; high is plausible.
    """
    spacing = pair_spacing(shapes, graph, settings)
    separation = np.maximum(graph.separation - spacing, 0.0)
    weight = np.exp(-separation / settings.tau)
    pairs = smaller_first(shapes, graph)
    lying = overlaps(
        shapes.sheets,
        shapes.planes,
        shapes.points,
        shapes.start,
        pairs,
        graph.middle,
        settings.radius,
        settings.tau,
        shapes.tolerance(settings),
    )
    crossing = crossings(shapes.trees, shapes.planes, pairs, spacing, shapes.cell, shapes.tolerance(settings))
    overlap, area, offset = lying.T
    columns = [separation, weight, overlap, crossing, angles(shapes, graph), offset, area]
    return np.column_stack(columns), 1.0 - weight * (overlap + crossing)


def pair_spacing(shapes: PatchShapes, graph: PatchGraph, settings: FeatureSettings) -> Floats:
    """Return the distance of points (n,) of the sparser patch of each pair, in metres, unless one is given for all."""
    if settings.spacing is not None:
        return np.full(len(graph.pairs), settings.spacing)
    return np.asarray(shapes.spacing[graph.pairs].max(axis=1, initial=0.0))


def smaller_first(shapes: PatchShapes, graph: PatchGraph) -> NDArray[np.int64]:
    """Return the pairs (n, 2), the patch with fewer points first, of equals that of less area, then by place."""
    order = np.lexsort((-shapes.size_rank, shapes.area, shapes.counts))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    pairs = graph.pairs.astype(np.int64)
    swap = rank[pairs[:, 0]] > rank[pairs[:, 1]]
    pairs[swap] = pairs[swap, ::-1]
    return np.ascontiguousarray(pairs)


def angles(shapes: PatchShapes, graph: PatchGraph) -> Floats:
    """Return the acute angle (n,) of each pair where they are closest, in degrees; exact for small ones too."""
    one, other = (shapes.normals_at(patch, graph.middle) for patch in graph.pairs.T)
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.abs(np.einsum("ij,ij->i", one, other)))))
