"""`patch_features`: from patches to what the random field sees."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, corner_of, from_corner, turn, turn_patches
from mapq.features import literal
from mapq.features.context import Beyond, measure_context
from mapq.features.edge import EDGE_NAMES, edge_features
from mapq.features.neighbours import find_neighbours, take_pairs
from mapq.features.node import NODE_NAMES, SHAPE_NAMES, node_features, shape_table
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes, measure_shapes, up_direction
from mapq.graph import PatchFeatures, PatchGraph
from mapq.patches import Patches
from prf.shell.progress import Reporter

N_STEPS = 3
"""What `progress` counts to: patches measured, neighbours found, pairs measured."""

CONFLICT = 0.05
"""A + R of a pair above which watched patches are joined: less is what chance makes of the points."""

Floats = NDArray[np.float64]


def patch_features(
    patches: Patches, settings: FeatureSettings | None = None, progress: Reporter | None = None
) -> PatchFeatures:
    """Return the neighbourhood graph of the patches with the features of its nodes and edges.

    `progress`: receives the steps done, of `N_STEPS`.

    Section 3.2 of the paper. The safe reading is finite for every patch with a point, and changes with neither the
    order of the points nor a shift of the map, nor a turn by quarters about z.
    """
    settings = settings or FeatureSettings()
    up, quarter = up_direction(patches, settings), GroundPlan.of(patches.cloud.xyz).quarter()
    x, y, z = turn(up, quarter).tolist()
    turned = turn_patches(patches, quarter)
    found = _in_own_axes(from_corner(turned, corner_of(turned)), replace(settings, up=(x, y, z)), progress)
    return found._replace(parameters={**found.parameters, "up": up.tolist()})


def _in_own_axes(patches: Patches, settings: FeatureSettings, progress: Reporter | None) -> PatchFeatures:
    shapes = measure_shapes(patches, settings)
    _tell(progress, 1)
    graph = find_neighbours(shapes, settings)
    _tell(progress, 2)
    found = _safe(patches, shapes, graph, settings) if settings.reading == "safe" else _literal(shapes, graph, settings)
    _tell(progress, 3)
    return found


class Columns(NamedTuple):
    """What a reading measures of patches (m) and pairs (n)."""

    graph: PatchGraph  # of the pairs that are joined
    node: Floats  # (m, p)
    edge: Floats  # (n, q)
    plausibility: Floats  # (n,)
    node_names: tuple[str, ...]
    edge_names: tuple[str, ...]


def measure_columns(
    patches: Patches, settings: FeatureSettings, beyond: Beyond | None = None, own: NDArray[np.bool_] | None = None
) -> tuple[PatchShapes, Columns]:
    """Return the shapes of patches, and their features with those of pairs.

    `patches`: in the map's own axes. `beyond`: what is known of the map, of which the patches are a part. `own` (m,):
    patches whose pairs are measured; None: all.
    """
    shapes = measure_shapes(patches, settings)
    return shapes, safe_features(patches, shapes, find_neighbours(shapes, settings, own), settings, beyond)


def safe_features(
    patches: Patches,
    shapes: PatchShapes,
    graph: PatchGraph,
    settings: FeatureSettings,
    beyond: Beyond | None = None,
) -> Columns:
    """Return the features of patches and of those pairs that are close or in conflict; context from `beyond`, too."""
    edge, plausibility = edge_features(shapes, graph, settings)
    conflict = edge[:, EDGE_NAMES.index("overlap")] + edge[:, EDGE_NAMES.index("crossing")] > CONFLICT
    joined = graph.close | conflict
    graph, edge, plausibility = take_pairs(graph, joined), edge[joined], plausibility[joined]
    context = measure_context(patches, shapes, graph, edge, settings, beyond)
    node = np.hstack([node_features(shapes, settings), context.node])
    edge = np.hstack([edge, context.edge])
    names = (*NODE_NAMES, *context.node_names), (*EDGE_NAMES, *context.edge_names)
    return Columns(graph, node, edge, plausibility, *names)


def _safe(patches: Patches, shapes: PatchShapes, graph: PatchGraph, settings: FeatureSettings) -> PatchFeatures:
    return _features(shapes, settings, safe_features(patches, shapes, graph, settings), 0)


def _literal(shapes: PatchShapes, graph: PatchGraph, settings: FeatureSettings) -> PatchFeatures:
    hulls = literal.measure_hulls(shapes)
    node, n_node = literal.cut(literal.literal_nodes(shapes, hulls))
    edge, n_edge = literal.cut(literal.literal_edges(shapes, graph, hulls, settings))
    plausibility = 1.0 - edge[:, 1] * (edge[:, 2] + edge[:, 3])
    columns = Columns(graph, node, edge, plausibility, literal.NODE_NAMES, EDGE_NAMES)
    return _features(shapes, settings, columns, n_node + n_edge)


def _features(shapes: PatchShapes, settings: FeatureSettings, columns: Columns, n_clipped: int) -> PatchFeatures:
    return PatchFeatures(
        reading=settings.reading,
        node=columns.node,
        pairs=columns.graph.pairs,
        edge=columns.edge,
        plausibility=columns.plausibility,
        node_names=columns.node_names,
        edge_names=columns.edge_names,
        n_clipped=n_clipped,
        shape=shape_table(shapes),
        shape_names=SHAPE_NAMES,
        context_names=columns.edge_names[len(EDGE_NAMES) :],
        parameters=settings.described(shapes.noise(settings), shapes.up.tolist()),
    )


def _tell(progress: Reporter | None, step: int) -> None:
    if progress is not None:
        progress.update(step)
