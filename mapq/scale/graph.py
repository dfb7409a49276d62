"""The graph of the whole map, put together from what was measured part by part."""

from __future__ import annotations

import numpy as np

from mapq.features.edge import EDGE_NAMES
from mapq.features.node import SHAPE_NAMES
from mapq.features.settings import FeatureSettings
from mapq.graph import PatchFeatures
from mapq.scale.measure import Measured


def join_measures(
    measured: list[Measured], n_patches: int, settings: FeatureSettings, up: list[float]
) -> PatchFeatures:
    """Return the features of all patches and pairs; pairs that two parts measured are taken once.

    Parameters
    ----------
    measured : list of Measured
        At least one; together they have every patch once.
    n_patches : int
    settings : FeatureSettings
        With the noise of the map.
    up : list of float
        Unit vector.
    """
    first = measured[0]
    node, shape = np.zeros((n_patches, first.node.shape[1])), np.zeros((n_patches, first.shape.shape[1]))
    for part in measured:
        node[part.patches], shape[part.patches] = part.node, part.shape
    pairs = np.concatenate([part.pairs for part in measured])
    _, rows = np.unique(pairs[:, 0] * max(n_patches, 1) + pairs[:, 1], return_index=True)
    pairs = pairs[rows].astype(np.int32)
    edge = np.concatenate([part.edge for part in measured])[rows]
    return PatchFeatures(
        reading="safe",
        node=node,
        pairs=pairs,
        edge=edge,
        plausibility=np.concatenate([part.plausibility for part in measured])[rows],
        node_names=first.node_names,
        edge_names=first.edge_names,
        n_clipped=0,
        shape=shape,
        shape_names=SHAPE_NAMES,
        context_names=first.edge_names[len(EDGE_NAMES) :],
        parameters=settings.described(max(settings.noise or settings.eps, settings.eps), up),
    )
