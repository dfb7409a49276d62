"""Why a patch has its label: the terms of its log-odds given its neighbours' labels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.crf.energy import (
    Inputs,
    coupling,
    make_field,
    model_inputs,
    node_columns,
)
from mapq.crf.evidence import columns_of
from mapq.graph import PatchFeatures
from mapq.kernels.boosted_trees import contributions
from mapq.model import NONE, Model
from mapq.patches import SUSPICIOUS

BASE = "base"
"""The bias of nodes: the log-odds of a patch of which nothing is known."""
NEIGHBOUR_LABEL = "neighbour label"
"""The coupling with a neighbour, which pulls towards its label."""

NO_OTHER = -1


class Terms(NamedTuple):
    """Terms of the log-odds of patches being suspicious, given the labels of their neighbours.

    In nats; positive means suspicious. The terms of a patch sum to ``log P(suspicious) - log P(plausible)`` in the
    random field given its neighbours' labels, which is twice the sum of its scores.
    """

    patch: NDArray[np.int64]  # (t,) ascending; the terms of a patch by size, largest first
    name: NDArray[np.int64]  # (t,) index into `names`
    # (t,) the feature in its own unit; for `BASE` 1, for `NEIGHBOUR_LABEL` the neighbour's label, 1 = suspicious
    value: NDArray[np.float64]
    contribution: NDArray[np.float64]  # (t,)
    other: NDArray[np.int64]  # (t,) the neighbour, or `NO_OTHER`
    names: tuple[str, ...]

    def starts(self, n_patches: int) -> NDArray[np.int64]:
        """Return where the terms of each patch begin, and where the last ones end (n_patches + 1,)."""
        return np.searchsorted(self.patch, np.arange(n_patches + 1))


class _Block(NamedTuple):
    """Terms of one name."""

    patch: NDArray[np.int64]
    name: str
    value: NDArray[np.float64]
    contribution: NDArray[np.float64]
    other: NDArray[np.int64]


def explain(features: PatchFeatures, model: Model, label: NDArray[np.uint8]) -> Terms:
    """Return the terms that led to labels (m,) of the patches of a map."""
    inputs = model_inputs(features, model)
    blocks = _node_blocks(features, inputs, model)
    if model.edge_model != NONE:
        blocks.append(_coupling_block(inputs, model, label))
    names = tuple(dict.fromkeys(block.name for block in blocks))
    patch = np.concatenate([block.patch for block in blocks])
    name = np.concatenate([np.full(len(block.patch), names.index(block.name)) for block in blocks])
    contribution = np.concatenate([block.contribution for block in blocks])
    other = np.concatenate([block.other for block in blocks])
    order = np.lexsort((other, name, -np.abs(contribution), patch))
    value = np.concatenate([block.value for block in blocks])
    return Terms(patch[order], name[order], value[order], contribution[order], other[order], names)


def local_log_odds(features: PatchFeatures, model: Model, label: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the log-odds (m,) of each patch being suspicious, given the labels (m,) of all others, in nats."""
    field = make_field(model_inputs(features, model), model.edge_model, model.weights)
    y = np.where(label == SUSPICIOUS, 1.0, -1.0)
    first, second = field.pairs.T
    pull = np.bincount(first, field.coupling * y[second], len(y)) + np.bincount(
        second, field.coupling * y[first], len(y)
    )
    return np.asarray(2.0 * (field.theta + pull))


def _node_blocks(features: PatchFeatures, inputs: Inputs, model: Model) -> list[_Block]:
    n_patches = len(inputs.node)
    patch, nobody = np.arange(n_patches), np.full(n_patches, NO_OTHER)
    base = np.full(n_patches, 2.0 * model.weights[0])
    if model.potential is not None:
        return _tree_blocks(features, inputs, model, base)
    blocks = [_Block(patch, BASE, np.ones(n_patches), base, nobody)]
    raw = node_columns(features, model.node.names)
    for index, name in enumerate(model.node.names):
        contribution = 2.0 * model.weights[1 + index] * inputs.node[:, index]
        blocks.append(_Block(patch, name, raw[:, index], contribution, nobody))
    return blocks


def _tree_blocks(features: PatchFeatures, inputs: Inputs, model: Model, base: NDArray[np.float64]) -> list[_Block]:
    """Return what each column adds to the evidence of the trees; a column of a pair belongs to its other patch."""
    assert model.potential is not None
    columns = columns_of(features).take(model.potential.names)
    added = contributions(model.potential.trees, columns.values)
    whole = model.potential.base + added.sum(axis=1)
    # Evidence beyond its bound is cut; its parts shrink with it.
    kept = np.divide(inputs.node[:, 0], whole, out=np.ones(len(whole)), where=whole != 0.0)
    weight = 2.0 * model.weights[1] * kept
    patch, nobody = np.arange(len(whole)), np.full(len(whole), NO_OTHER)
    start = base + weight * (model.potential.base + added[:, -1])
    blocks = [_Block(patch, BASE, np.ones(len(whole)), start, nobody)]
    for index, name in enumerate(columns.names):
        some = np.flatnonzero(added[:, index])
        block = _Block(
            some, name, columns.values[some, index], (weight * added[:, index])[some], columns.other[some, index]
        )
        blocks.append(block)
    return blocks


def _coupling_block(inputs: Inputs, model: Model, label: NDArray[np.uint8]) -> _Block:
    pull = 2.0 * coupling(inputs, model.edge_model, model.weights)
    is_suspicious = (label == SUSPICIOUS).astype(np.float64)
    of_first, of_second = is_suspicious[inputs.pairs.T]
    to_first, to_second = pull * (2.0 * of_second - 1.0), pull * (2.0 * of_first - 1.0)
    first, second = inputs.pairs.T
    return _Block(
        np.concatenate([first, second]),
        NEIGHBOUR_LABEL,
        np.concatenate([of_second, of_first]),
        np.concatenate([to_first, to_second]),
        np.concatenate([second, first]),
    )
