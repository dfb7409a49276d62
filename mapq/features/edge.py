"""Edge features: how two neighbouring patches lie to one another (equations 9 to 13, safe reading)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.graph import PatchGraph
from mapq.kernels.crossing import crossings
from mapq.kernels.overlap import overlaps

EDGE_NAMES = ("separation", "weight", "overlap", "crossing", "angle_deg", "offset", "overlap_area")

Floats = NDArray[np.float64]


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
    """Return the acute angle (n,) of the planes of each pair, in degrees; exact for small ones too."""
    one, other = shapes.normal[graph.pairs[:, 0]], shapes.normal[graph.pairs[:, 1]]
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, np.abs(np.einsum("ij,ij->i", one, other)))))
