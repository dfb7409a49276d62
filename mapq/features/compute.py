"""`patch_features`: from patches to what the random field sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, corner_of, from_corner, turn, turn_patches
from mapq.configuration import IN_MODELS, STORED, FeatureSettings
from mapq.features.context import Beyond, measure_context
from mapq.features.pairs import EDGE_NAMES, PatchGraph, edge_features, find_neighbours, take_pairs
from mapq.features.shape import (
    NODE_NAMES,
    SHAPE_NAMES,
    PatchShapes,
    measure_shapes,
    node_features,
    shape_table,
    up_direction,
)
from mapq.features.table import PatchFeatures
from mapq.model import Model
from mapq.patches import Patches
from prf.shell.cli.console import Report, report_nothing
from prf.shell.errors import ArgumentError, InputError

N_STEPS = 3
"""What `progress` counts to: patches measured, neighbours found, pairs measured."""

MIN_CONFLICT = 0.05
"""A + R of a pair above which watched patches are joined: less is what chance makes of the points."""

Floats = NDArray[np.float64]


def patch_features(
    patches: Patches, settings: FeatureSettings | None = None, progress: Report | None = None
) -> PatchFeatures:
    """Return the neighbourhood graph of the patches with the features of its nodes and edges.

    `progress`: receives the steps done, of `N_STEPS`.

    Section 3.2 of the paper. Features are finite for every patch with a point, and change with neither the order of
    the points nor a shift of the map, nor a turn by quarters about z.
    """
    settings = settings or FeatureSettings()
    found = measure(*in_own_axes(patches, settings), progress=progress)
    return found._replace(parameters={**found.parameters, "up": up_direction(patches, settings).tolist()})


def in_own_axes(patches: Patches, settings: FeatureSettings) -> tuple[Patches, FeatureSettings]:
    """Return patches in the map's own axes, their places counted from the corner, and settings with up in these."""
    quarter = GroundPlan.of(patches.cloud.xyz).quarter()
    x, y, z = turn(up_direction(patches, settings), quarter).tolist()
    turned = turn_patches(patches, quarter)
    return from_corner(turned, corner_of(turned)), settings.replace(up=(x, y, z))


def measure(
    patches: Patches,
    settings: FeatureSettings,
    beyond: Beyond | None = None,
    own: NDArray[np.bool_] | None = None,
    progress: Report | None = None,
) -> PatchFeatures:
    """Return the features of patches that are in the map's own axes.

    `beyond`: what is known of the map, of which the patches are a part. `own` (m,): patches whose pairs are measured;
    None: all.
    """
    report = progress or report_nothing
    shapes = measure_shapes(patches, settings)
    report(1)
    graph = find_neighbours(shapes, settings, own)
    report(2)
    found = _features_of(patches, shapes, graph, settings, beyond)
    report(3)
    return found


def _features_of(
    patches: Patches, shapes: PatchShapes, graph: PatchGraph, settings: FeatureSettings, beyond: Beyond | None
) -> PatchFeatures:
    """Return the features of patches, and of the pairs that are close or in conflict, with the context."""
    edge, plausibility = edge_features(shapes, graph, settings)
    conflict = edge[:, EDGE_NAMES.index("overlap")] + edge[:, EDGE_NAMES.index("crossing")] > MIN_CONFLICT
    joined = graph.close | conflict
    graph, edge = take_pairs(graph, joined), edge[joined]
    of_patches, of_pairs = measure_context(patches, shapes, graph, edge, settings, beyond)
    return PatchFeatures(
        node=np.column_stack([node_features(shapes, settings), *of_patches.values()]),
        pairs=graph.pairs,
        edge=np.column_stack([edge, *of_pairs.values()]),
        plausibility=plausibility[joined],
        node_names=(*NODE_NAMES, *of_patches),
        edge_names=(*EDGE_NAMES, *of_pairs),
        shape=shape_table(shapes),
        shape_names=SHAPE_NAMES,
        context_names=tuple(of_pairs),
        parameters=settings.described(shapes.noise(settings), shapes.up.tolist()),
    )


def feature_settings(model: Model) -> FeatureSettings:
    """Return the settings with which the model's features were measured.

    Raises InputError if one is missing, unknown, or outside its domain.
    """
    names = {STORED.get(name, name): name for name in IN_MODELS}
    for name in sorted(set(names) ^ set(model.features)):
        state = "is missing" if name in names else "is not known to this release"
        raise InputError(f"the model's feature setting {name} {state}. Train the model anew.")
    try:
        return FeatureSettings(**{names[name]: value for name, value in model.features.items()})
    except ArgumentError as error:
        raise InputError(f"the model's feature settings cannot be used ({error}) Train the model anew.") from None
