"""`Model`: the parameters of the random field, and what is needed to use them on another map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

FULL, SYMMETRIC, NONE = "full", "symmetric", "none"
EDGE_MODELS = (FULL, SYMMETRIC, NONE)
"""With the field of pairs; only same or different, as in the paper; without edges: logistic regression."""

PLAUSIBILITY = "plausibility"
"""Name under which x_ij of equation 13 stands among the edge features."""

CLIP = 5.0
"""Standardised values are cut here: a patch that is stranger than all others must not outvote its neighbours."""


@dataclass(frozen=True)
class Scaling:
    """Robust standardisation of named columns: ``clip((value - median) / scale)``.

    Attributes
    ----------
    names : tuple of str
    median, scale : (k,) float64
        In the unit of the column; scales are positive.
    clip : float
        Bound of standardised values.
    """

    names: tuple[str, ...]
    median: NDArray[np.float64]
    scale: NDArray[np.float64]
    clip: float = CLIP

    def apply(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return standardised columns (n, k)."""
        return np.clip((values - self.median) / self.scale, -self.clip, self.clip)


@dataclass(frozen=True)
class Model:
    """A trained random field; docs/crf.md derives it.

    Attributes
    ----------
    edge_model : str
        One of `EDGE_MODELS`.
    features : mapping
        The settings with which features were measured.
    node, edge : Scaling
        Of the node features f, and of the edge features h of the field.
    x_range : (float, float)
        x_ij is cut to this range before anything else, so that the coupling is non-negative on any map.
    weights : (n_parameters,) float64
        In the order of `parameter_names`.
    temperature : float
        Probability = logistic function of temperature times the difference of min-marginals.
    training : mapping
        What the model was trained on, and its held-out scores.
    """

    edge_model: str
    features: Mapping[str, Any]
    node: Scaling
    edge: Scaling
    x_range: tuple[float, float]
    weights: NDArray[np.float64]
    temperature: float = 1.0
    training: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the weights, ``group.name``."""
        return parameter_names(self.edge_model, self.node.names, self.edge.names)


def parameter_names(edge_model: str, node_names: tuple[str, ...], edge_names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of all weights, ``group.name``, in their order.

    ``node``: w0 and w. ``field``: u0 and u, on pairs whatever their labels. ``coupling``: v0 + v1 x at both ends of the
    range of x, which must not be negative; linear between them, so that two bounds suffice.
    """
    names = ["node.bias", *(f"node.{name}" for name in node_names)]
    if edge_model == FULL:
        names += ["field.bias", *(f"field.{name}" for name in edge_names)]
    if edge_model in (FULL, SYMMETRIC):
        names += ["coupling.at_x_min", "coupling.at_x_max"]
    return tuple(names)
