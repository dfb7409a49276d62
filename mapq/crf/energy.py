"""The score of a labelling: terms of nodes, of pairs, and of the labels of pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.crf.trees import with_evidence
from mapq.features.table import PatchFeatures
from mapq.labels import LABEL_TOLERANCE
from mapq.model import NONE, PLAUSIBILITY, Model, Scaling
from prf.shell.errors import InputError


class Inputs(NamedTuple):
    """What the field of one map is linear in."""

    node: NDArray[np.float64]  # (m, k) standardised node features f
    pairs: NDArray[np.int64]  # (e, 2)
    position: NDArray[np.float64]  # (e,) where x_ij lies in the range of the model, 0 to 1
    # (e,) of the coupling's weights that a pair has: 1, or one by the larger number of neighbours of its patches
    share: NDArray[np.float64]


class Field(NamedTuple):
    """A binary field with labels y = +1 (suspicious) and -1 (plausible), whose score is to be made as large as can be.

    score(y) = sum_i theta_i y_i + sum_ij coupling_ij y_i y_j
    """

    theta: NDArray[np.float64]  # (m,)
    pairs: NDArray[np.int64]  # (e, 2)
    coupling: NDArray[np.float64]  # (e,) not negative in a field that a graph cut can solve

    def score(self, y: NDArray[np.float64]) -> float:
        """Return the score of labels (m,) in {-1, +1}."""
        first, second = self.pairs[:, 0], self.pairs[:, 1]
        return float(self.theta @ y + self.coupling @ (y[first] * y[second]))


def node_columns(features: PatchFeatures, names: tuple[str, ...]) -> NDArray[np.float64]:
    """Return named node features (m, k).

    Raises InputError if there is no feature of that name.
    """
    missing = [name for name in names if name not in features.node_names]
    if missing:
        known = ", ".join(features.node_names) or "none"
        raise InputError(f"expected a node feature {missing[0]}; these features have {known}.")
    return features.node[:, [features.node_names.index(name) for name in names]]


def require_finite(features: PatchFeatures) -> None:
    """Raise InputError if a feature is infinite; nan is what is not known."""
    named = (
        *zip(features.node_names, features.node.T, strict=True),
        *zip(features.edge_names, features.edge.T, strict=True),
        (PLAUSIBILITY, features.plausibility),
    )
    for name, column in named:
        n_bad = int(np.count_nonzero(np.isinf(column)))
        if n_bad:
            raise InputError(f"feature {name} is infinite in {n_bad} of {len(column)} places. Look at mapq features.")


def make_inputs(
    features: PatchFeatures,
    edge_model: str,
    node: Scaling,
    x_range: tuple[float, float],
    shared: bool = False,
) -> Inputs:
    """Return the standardised inputs of one map; without edges if the model has none.

    With `shared` couplings many weak neighbours do not outvote what is measured on a patch.
    """
    require_finite(features)
    scaled = node.apply(node_columns(features, node.names))
    if edge_model == NONE:
        return Inputs(scaled, np.empty((0, 2), np.int64), np.empty(0), np.empty(0))
    low, high = x_range
    span = high - low if high > low else 1.0
    position = (np.clip(features.plausibility, low, high) - low) / span
    pairs = features.pairs.astype(np.int64)
    n_neighbours = np.bincount(pairs.ravel(), minlength=len(scaled))
    share = 1.0 / n_neighbours[pairs].max(axis=1, initial=1) if shared else np.ones(len(pairs))
    return Inputs(scaled, pairs, position, share)


def unary_design(inputs: Inputs) -> NDArray[np.float64]:
    """Return the columns (m, p) whose product with the first p weights is theta."""
    return np.column_stack([np.ones(len(inputs.node)), inputs.node])


def label_design(inputs: Inputs, edge_model: str, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the columns (m, 2 or 0) of the coupling's weights, given labels y (m,): +1, -1, or 0 where unknown."""
    n_patches = len(inputs.node)
    if edge_model == NONE:
        return np.empty((n_patches, 0))
    first, second = inputs.pairs.T
    parts = inputs.share[:, None] * np.column_stack([1.0 - inputs.position, inputs.position])
    to_first = _sum_at(first, y[second, None] * parts, n_patches)
    return to_first + _sum_at(second, y[first, None] * parts, n_patches)


def coupling(inputs: Inputs, edge_model: str, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pairs' shares of v0 + v1 x_ij (e,), by both ends so that rounding makes none of them negative."""
    if edge_model == NONE:
        return np.empty(0)
    at_low, at_high = weights[-2:]
    return np.asarray(inputs.share * (at_low * (1.0 - inputs.position) + at_high * inputs.position))


def make_field(inputs: Inputs, edge_model: str, weights: NDArray[np.float64]) -> Field:
    """Return the field that `weights` make of a map."""
    design = unary_design(inputs)
    return Field(design @ weights[: design.shape[1]], inputs.pairs, coupling(inputs, edge_model, weights))


def model_inputs(features: PatchFeatures, model: Model, tolerance: float = LABEL_TOLERANCE) -> Inputs:
    """Return the inputs of a map as `model` standardises them; `tolerance`: metres from which surfaces are wrong."""
    known, shared = with_evidence(features, model.potential, tolerance), model.potential is not None
    return make_inputs(known, model.edge_model, model.node, model.x_range, shared)


def _sum_at(index: NDArray[np.int64], values: NDArray[np.float64], n_patches: int) -> NDArray[np.float64]:
    if len(index) == 0:
        return np.zeros((n_patches, values.shape[1]))
    return np.column_stack([np.bincount(index, column, n_patches) for column in values.T])
