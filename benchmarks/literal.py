"""Equations 6 to 13 as they are printed, which the benchmarks compare with what `mapq` measures.

Both share the neighbourhood, here of the closest patches alone. Where an equation has no bound its values are cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from mapq.configuration import FeatureSettings
from mapq.features import PatchShapes, measure_shapes, patch_features
from mapq.features.compute import in_own_axes
from mapq.features.pairs import EDGE_NAMES, PatchGraph, angles, find_neighbours
from mapq.features.table import PatchFeatures
from mapq.patches import Patches

NODE_NAMES = ("inverse_mse", "inverse_up_cosine", "volume_per_area")
BOUND = 1e6
"""Values beyond are cut to it, infinite ones too; nan, which is 0/0 here, becomes 0."""

Floats = NDArray[np.float64]


class Hulls(NamedTuple):
    """Convex hulls of each patch."""

    volume: Floats  # (m,) of the points, in m³
    level_area: Floats  # (m,) of the points projected to the plane that is normal to up, in m²: "the XY plane"
    area: Floats  # (m,) in the patch's own plane, in m²
    # (k_i, 3) corners of the hull of the points, or all points where they have none
    corners: list[Floats]


def measure_by(patches: Patches, settings: FeatureSettings | None) -> PatchFeatures:
    """Return the features of patches by settings of `mapq`; None: by the equations as they are printed."""
    return literal_features(patches) if settings is None else patch_features(patches, settings)


def literal_features(patches: Patches, settings: FeatureSettings | None = None) -> PatchFeatures:
    """Return what equations 6 to 13 say of patches and of each pair of the closest ones; without context.

    `settings`: those of the neighbourhood, and `tau`.
    """
    own, settings = in_own_axes(patches, (settings or FeatureSettings()).replace(watched=0))
    shapes = measure_shapes(own, settings)
    graph, hulls = find_neighbours(shapes, settings), measure_hulls(shapes)
    node = cut(literal_nodes(shapes, hulls))
    edge = cut(literal_edges(shapes, graph, hulls, settings))
    plausibility = 1.0 - edge[:, 1] * (edge[:, 2] + edge[:, 3])
    return PatchFeatures(node, graph.pairs, edge, plausibility, NODE_NAMES, EDGE_NAMES)


def literal_nodes(shapes: PatchShapes, hulls: Hulls) -> Floats:
    """Return 1 / MSE in 1/m² (equation 6), 1 / (Z . n) (7) and V / A in metres (8), not yet cut."""
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = [1.0 / shapes.mse, 1.0 / (shapes.normal @ shapes.up), hulls.volume / hulls.level_area]
    return np.column_stack(columns)


def literal_edges(shapes: PatchShapes, graph: PatchGraph, hulls: Hulls, settings: FeatureSettings) -> Floats:
    """Return separation, weight, overlap, crossing, angle, offset and shadow area, not yet cut.

    The separation is rho itself (9); the shadow of i on j has the area A_i |cos angle|, and both A under the fraction
    are areas in the XY plane (11); R is taken of every pair that is not parallel, whether it meets or not (12).
    """
    i, j = graph.pairs.T
    cosine = np.abs(np.einsum("ij,ij->i", shapes.normal[i], shapes.normal[j]))
    shadow = np.maximum(hulls.area[i], hulls.area[j]) * cosine
    with np.errstate(divide="ignore", invalid="ignore"):
        overlap = shadow / np.minimum(hulls.level_area[i], hulls.level_area[j])
    crossing = np.array([edge_ratio(shapes, hulls, a, b) for a, b in graph.pairs.tolist()]).reshape(-1)
    offset = np.abs(np.einsum("ij,ij->i", shapes.centre[j] - shapes.centre[i], shapes.normal[i]))
    weight = np.exp(-graph.separation / settings.tau)
    return np.column_stack([graph.separation, weight, overlap, crossing, angles(shapes, graph), offset, shadow])


def edge_ratio(shapes: PatchShapes, hulls: Hulls, i: int, j: int) -> float:
    """Return min(r_ij, r_ji): nearest over farthest edge distance from the line of intersection; 0 if parallel."""
    sine = float(np.linalg.norm(np.cross(shapes.normal[i], shapes.normal[j])))
    if sine < 1e-12:
        return 0.0
    ratios = []
    for a, b in ((i, j), (j, i)):
        own, other = shapes.normal[a], shapes.normal[b]
        across = (other - (own @ other) * own) / sine
        level = (shapes.centre[a] - shapes.centre[b]) @ other / sine
        along = (hulls.corners[a] - shapes.centre[a]) @ across + level
        places = np.abs([along.min(), along.max()])
        ratios.append(float(places.min() / places.max()) if places.max() > 0.0 else 0.0)
    return min(ratios)


def measure_hulls(shapes: PatchShapes) -> Hulls:
    """Return the hulls of all patches; points on a line or in a plane have area or volume 0."""
    level = plane_axes(shapes.up)
    n_patches = len(shapes)
    volume, level_area, area = np.zeros(n_patches), np.zeros(n_patches), np.zeros(n_patches)
    corners = []
    for i in range(n_patches):
        points = shapes.points[shapes.start[i] : shapes.start[i + 1]] - shapes.centre[i]
        volume[i], kept = hull_of(points)
        level_area[i] = hull_of(points[kept] @ level)[0]
        area[i] = hull_of(points[kept] @ np.stack([shapes.across[i], shapes.along[i]], axis=1))[0]
        corners.append(points[kept] + shapes.centre[i])
    return Hulls(volume, level_area, area, corners)


def hull_of(points: Floats) -> tuple[float, NDArray[np.int64]]:
    """Return volume (area, of points in a plane) of a convex hull, and its corners; 0 and all points if it is flat."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return 0.0, np.arange(len(points))
    return float(hull.volume), np.asarray(hull.vertices, np.int64)


def plane_axes(normal: Floats) -> Floats:
    """Return two unit vectors (3, 2) that span the plane of a unit normal; x and y if it is z."""
    x = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = x - (x @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)], axis=1)


def cut(values: Floats) -> Floats:
    """Return the values within `BOUND`, 0 for nan."""
    return np.clip(np.nan_to_num(values, nan=0.0, posinf=BOUND, neginf=-BOUND), -BOUND, BOUND)
