"""Why a patch has its label: the terms of its log-odds given its neighbours' labels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.crf.energy import (
    Inputs,
    coupling,
    model_inputs,
    node_columns,
)
from mapq.crf.trees import KNOWS_SCANS, LOW_RATIO, columns_of, decided
from mapq.features.table import PatchFeatures
from mapq.kernels.boosted_trees import contributions
from mapq.labels import LABEL_TOLERANCE, SUSPICIOUS
from mapq.model import NONE, Columns, Model

BASE = "base"
"""The bias of nodes: the log-odds of a patch of which nothing is known."""
NEIGHBOUR_LABEL = "neighbour label"
"""The coupling with a neighbour, which pulls towards its label."""

NO_OTHER = -1

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Terms(NamedTuple):
    """Terms of the log-odds of patches being suspicious, given the labels of their neighbours.

    In nats; positive means suspicious. The terms of a patch sum to ``log P(suspicious) - log P(plausible)`` in the
    random field given its neighbours' labels, which is twice the sum of its scores.
    """

    patch: Ints  # (t,) ascending; the terms of a patch by size, largest first
    name: Ints  # (t,) index into `names`
    # (t,) the feature in its own unit; for `BASE` 1, for `NEIGHBOUR_LABEL` the neighbour's label, 1 = suspicious
    value: NDArray[np.float64]
    contribution: Floats  # (t,)
    other: Ints  # (t,) the neighbour, or `NO_OTHER`
    names: tuple[str, ...]

    def starts(self, n_patches: int) -> NDArray[np.int64]:
        """Return where the terms of each patch begin, and where the last ones end (n_patches + 1,)."""
        return np.searchsorted(self.patch, np.arange(n_patches + 1))


def explain(
    features: PatchFeatures, model: Model, label: NDArray[np.uint8], tolerance: float = LABEL_TOLERANCE
) -> Terms:
    """Return the terms that led to labels (m,) of the patches of a map at a tolerance in metres."""
    inputs = model_inputs(features, model, tolerance)
    if model.potential is None:
        blocks = list(_node_blocks(features, inputs, model))
    else:
        blocks = list(_tree_blocks(columns_of(features, tolerance).take(model.potential.names), inputs, model))
    if model.edge_model != NONE:
        blocks.append(_coupling_block(inputs, model, label))
    block_names, *columns = zip(*blocks, strict=True)
    names = tuple(dict.fromkeys(block_names))
    name = np.repeat([names.index(each) for each in block_names], [len(patch) for patch in columns[0]])
    patch, value, contribution, other = (np.concatenate(column) for column in columns)
    order = np.lexsort((other, name, -np.abs(contribution), patch))
    return Terms(patch[order], name[order], value[order], contribution[order], other[order], names)


_Block = tuple[str, Ints, Floats, Floats, Ints]
"""Terms of one name: the name, and patch, value, contribution and other patch of each."""


def _node_blocks(features: PatchFeatures, inputs: Inputs, model: Model) -> Iterator[_Block]:
    """Yield the bias, and what each standardised feature of a linear field adds."""
    ones = np.ones(len(inputs.node))
    patch, nobody = np.arange(len(ones)), np.full(len(ones), NO_OTHER)
    yield BASE, patch, ones, 2.0 * model.weights[0] * ones, nobody
    raw = node_columns(features, model.node.names)
    for index, name in enumerate(model.node.names):
        yield name, patch, raw[:, index], 2.0 * model.weights[1 + index] * inputs.node[:, index], nobody


def _tree_blocks(columns: Columns, inputs: Inputs, model: Model) -> Iterator[_Block]:
    """Yield what each column adds to the evidence of the trees; a column of a pair belongs to its other patch."""
    assert model.potential is not None
    added = contributions(model.potential.trees, columns.values)
    # What trees start from where scans are known, and where they are not, is no reason for one of the patches.
    if KNOWS_SCANS in columns.names:
        added[:, -1] += added[:, columns.names.index(KNOWS_SCANS)]
        added[:, columns.names.index(KNOWS_SCANS)] = 0.0
    by_trees = model.potential.base + added.sum(axis=1)
    whole = decided(columns, by_trees)
    # What a disagreement that is surely above the tolerance decides beyond the trees is its lower bound's.
    if LOW_RATIO in columns.names:
        added[:, columns.names.index(LOW_RATIO)] += whole - by_trees
    # Evidence beyond its bound is cut; its parts shrink with it.
    kept = np.divide(inputs.node[:, 0], whole, out=np.ones(len(whole)), where=whole != 0.0)
    weight = 2.0 * model.weights[1] * kept
    ones = np.ones(len(whole))
    start = 2.0 * model.weights[0] + weight * (model.potential.base + added[:, -1])
    yield BASE, np.arange(len(whole)), ones, start, np.full(len(whole), NO_OTHER)
    for index, name in enumerate(columns.names):
        some = np.flatnonzero(added[:, index])
        yield name, some, columns.values[some, index], (weight * added[:, index])[some], columns.other[some, index]


def _coupling_block(inputs: Inputs, model: Model, label: NDArray[np.uint8]) -> _Block:
    """Return how each neighbour pulls towards its label."""
    pull = 2.0 * coupling(inputs, model.edge_model, model.weights)
    patch = inputs.pairs.T.ravel()
    other = inputs.pairs[:, ::-1].T.ravel()
    value = (label == SUSPICIOUS).astype(np.float64)[other]
    return NEIGHBOUR_LABEL, patch, value, np.tile(pull, 2) * (2.0 * value - 1.0), other
