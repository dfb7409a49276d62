"""`PatchGraph`: which patches are neighbours, and what is measured on patches and pairs."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


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


class PatchFeatures(NamedTuple):
    """What the random field sees of a map.

    Attributes
    ----------
    reading : str
        ``safe`` or ``literal``: how equations 6-13 were read.
    node : (n_patches, n_node) float64
        Node features, named by `node_names`.
    pairs : (n_pairs, 2) int32
        As in :class:`PatchGraph`.
    edge : (n_pairs, n_edge) float64
        Edge features, named by `edge_names`.
    plausibility : (n_pairs,) float64
        x_ij of equation 13: high is plausible.
    node_names, edge_names : tuple of str
    n_clipped : int
        Values of the literal reading that were not finite, or too large, and were cut.
    shape : (n_patches, n_shape) float64
        Measures of a patch for people, named by `shape_names`: counts, metres, m², degrees. The random field has none.
    shape_names : tuple of str
    context_names : tuple of str
        Those of `edge_names` that are context, beyond the paper.
    parameters : mapping
        What the features were computed with, estimates included: numbers in metres, the up direction.
    """

    reading: str
    node: NDArray[np.float64]
    pairs: NDArray[np.int32]
    edge: NDArray[np.float64]
    plausibility: NDArray[np.float64]
    node_names: tuple[str, ...]
    edge_names: tuple[str, ...]
    n_clipped: int
    shape: NDArray[np.float64] = np.zeros((0, 0))
    shape_names: tuple[str, ...] = ()
    context_names: tuple[str, ...] = ()
    parameters: Mapping[str, Any] = MappingProxyType({})

    @property
    def nodes(self) -> NDArray[np.void]:
        """A row a patch (m,), columns by name: ``nodes["thickness_m"]``."""
        from mapq.features.table import node_table

        return node_table(self).array()

    @property
    def edges(self) -> NDArray[np.void]:
        """A row a pair of neighbours ``i``, ``j``: ``edges["plausibility"]`` is x_ij, low where walls are doubled."""
        from mapq.features.table import edge_table

        return edge_table(self).array()

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of each column of `nodes` and `edges`."""
        from mapq.features.table import UNITS

        return UNITS[self.reading]

    @property
    def disagreement(self) -> NDArray[np.float64]:
        """Lower bound, value and upper bound (m, 3) of what scans disagree by on each patch, metres; nan unknown."""
        names = ("disagreement_low", "disagreement", "disagreement_high")
        if not set(names) <= set(self.node_names):
            return np.full((len(self.node), 3), np.nan)
        return self.node[:, [self.node_names.index(name) for name in names]]
