"""`patch_features`: from patches to what the random field sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, corner_of, from_corner, turn, turn_patches
from mapq.configuration import IN_MODELS, STORED, FeatureSettings
from mapq.features import literal
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

    Section 3.2 of the paper. The safe reading is finite for every patch with a point, and changes with neither the
    order of the points nor a shift of the map, nor a turn by quarters about z.
    """
    settings = settings or FeatureSettings()
    up, quarter = up_direction(patches, settings), GroundPlan.of(patches.cloud.xyz).quarter()
    x, y, z = turn(up, quarter).tolist()
    turned = turn_patches(patches, quarter)
    own = from_corner(turned, corner_of(turned))
    found = measure(own, settings.replace(up=(x, y, z)), progress=progress)
    return found._replace(parameters={**found.parameters, "up": up.tolist()})


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
    found = PatchFeatures(
        reading=settings.reading,
        node=node_features(shapes, settings),
        pairs=graph.pairs,
        edge=np.zeros((0, 0)),
        plausibility=np.zeros(0),
        node_names=NODE_NAMES,
        edge_names=EDGE_NAMES,
        n_clipped=0,
        shape=shape_table(shapes),
        shape_names=SHAPE_NAMES,
        context_names=(),
        parameters=settings.described(shapes.noise(settings), shapes.up.tolist()),
    )
    if settings.reading == "safe":
        found = _with_pairs(found, patches, shapes, graph, settings, beyond)
    else:
        found = found._replace(**literal.measure(shapes, graph, settings))
    report(3)
    return found


def _with_pairs(
    found: PatchFeatures,
    patches: Patches,
    shapes: PatchShapes,
    graph: PatchGraph,
    settings: FeatureSettings,
    beyond: Beyond | None,
) -> PatchFeatures:
    """Return features with those of the pairs that are close or in conflict, and with the context."""
    edge, plausibility = edge_features(shapes, graph, settings)
    conflict = edge[:, EDGE_NAMES.index("overlap")] + edge[:, EDGE_NAMES.index("crossing")] > MIN_CONFLICT
    joined = graph.close | conflict
    graph, edge = take_pairs(graph, joined), edge[joined]
    of_patches, of_pairs = measure_context(patches, shapes, graph, edge, settings, beyond)
    return found._replace(
        node=np.column_stack([found.node, *of_patches.values()]),
        pairs=graph.pairs,
        edge=np.column_stack([edge, *of_pairs.values()]),
        plausibility=plausibility[joined],
        node_names=(*NODE_NAMES, *of_patches),
        edge_names=(*EDGE_NAMES, *of_pairs),
        context_names=tuple(of_pairs),
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
