"""`PatchGraph`: which patches are neighbours, and what is measured on patches and pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class PatchGraph(NamedTuple):
    """The neighbourhood of the random field.

    Attributes
    ----------
    n_patches : int
    pairs : (n_pairs, 2) int32
        Each pair of neighbours once, the smaller number first, in ascending order.
    separation : (n_pairs,) float64
        Shortest distance between the points of the two patches, in metres (rho of equation 9).
    """

    n_patches: int
    pairs: NDArray[np.int32]
    separation: NDArray[np.float64]


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
    """

    reading: str
    node: NDArray[np.float64]
    pairs: NDArray[np.int32]
    edge: NDArray[np.float64]
    plausibility: NDArray[np.float64]
    node_names: tuple[str, ...]
    edge_names: tuple[str, ...]
    n_clipped: int
