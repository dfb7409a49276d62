"""The random field over patches by its definition: every labelling scored by loops over patches and pairs."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from mapq.crf.energy import Field, make_field, model_inputs
from mapq.crf.train import TrainingMap
from mapq.crf.trees import columns_of
from mapq.features.table import PatchFeatures
from mapq.labels import SUSPICIOUS
from mapq.model import EVIDENCE, NONE, SYMMETRIC, Calibration, Model, Potential, Scaling, parameter_names
from tests.reference.mapq_trees import slow_log_odds

NODE_NAMES = ("fit", "tilt", "thickness")
EDGE_NAMES = ("separation", "overlap")


def draw_pairs(rng: np.random.Generator, n_patches: int, n_pairs: int) -> np.ndarray:
    """Return up to `n_pairs` different pairs, smaller number first, ascending."""
    found = set()
    for _ in range(n_pairs if n_patches > 1 else 0):
        found.add(tuple(sorted(rng.choice(n_patches, 2, replace=False).tolist())))
    return np.array(sorted(found), np.int32).reshape(-1, 2)


def draw_features(
    rng: np.random.Generator, n_patches: int, n_pairs: int, edge_names: tuple[str, ...] = EDGE_NAMES
) -> PatchFeatures:
    """Return features without any sense."""
    pairs = draw_pairs(rng, n_patches, n_pairs)
    node = rng.normal(size=(n_patches, len(NODE_NAMES))) * [1.0, 0.1, 30.0] + [5.0, 0.0, -4.0]
    edge = rng.exponential(size=(len(pairs), len(edge_names)))
    return PatchFeatures(node, pairs, edge, rng.uniform(-1.0, 1.0, len(pairs)), NODE_NAMES, edge_names)


def draw_model(
    rng: np.random.Generator,
    edge_model: str = SYMMETRIC,
    potential: Potential | None = None,
) -> Model:
    """Return a model with weights of all sizes, coupling of several units at one end or none; trees cut at 1.5 nats."""
    node = Scaling(NODE_NAMES, rng.normal(size=3), rng.uniform(0.1, 2.0, 3))
    if potential is not None:
        node = Scaling((EVIDENCE,), np.zeros(1), np.ones(1), 1.5)
    weights = rng.normal(size=len(parameter_names(edge_model, node.names)))
    if edge_model != NONE:
        weights[-2:] = np.maximum(weights[-2:], 0.0)
    return Model(edge_model, {}, node, (-0.8, 0.7), weights, Calibration(slope=0.7), potential=potential)


def slow_score(features: PatchFeatures, model: Model, y: list[int]) -> float:
    """Return the score of labels +1 and -1, as the definition has it: v0 and v1, raw features scaled one by one."""
    weight = dict(zip(model.parameter_names, model.weights.tolist(), strict=True))
    total = 0.0
    if model.potential is not None:
        evidence = slow_log_odds(model.potential, columns_of(features))
        features = features._replace(node=np.array(evidence)[:, None], node_names=(EVIDENCE,))
    for i, label in enumerate(y):
        value = weight["node.bias"]
        for name in model.node.names:
            raw = features.node[i, features.node_names.index(name)]
            value += weight[f"node.{name}"] * _scaled(model.node, name, raw)
        total += label * value
    if model.edge_model == NONE:
        return total
    low, high = model.x_range
    v1 = (weight["coupling.at_x_max"] - weight["coupling.at_x_min"]) / (high - low)
    v0 = weight["coupling.at_x_min"] - v1 * low
    for number, (i, j) in enumerate(features.pairs.tolist()):
        x = min(max(float(features.plausibility[number]), low), high)
        both = features.pairs.ravel().tolist()
        share = 1.0 if model.potential is None else 1.0 / max(both.count(i), both.count(j))
        total += y[i] * y[j] * share * (v0 + v1 * x)
    return total


def slow_log_pseudo_likelihood(maps: list[TrainingMap], model: Model) -> float:
    """Return the sum over all patches of log P(label | all other labels), from scores of whole labellings."""
    total = 0.0
    for training_map in maps:
        y = [1 if label else -1 for label in training_map.label.tolist()]
        for i, label in enumerate(y):
            same = slow_score(training_map.features, model, y)
            other = slow_score(training_map.features, model, [*y[:i], -label, *y[i + 1 :]])
            total += -math.log1p(math.exp(other - same))
    return total


def enumerate_field(field: Field) -> tuple[np.ndarray, np.ndarray]:
    """Return the scores (2**m,) of all labellings (2**m, m)."""
    labellings = np.array(list(itertools.product([-1.0, 1.0], repeat=len(field.theta))))
    first, second = field.pairs.T
    return labellings @ field.theta + (labellings[:, first] * labellings[:, second]) @ field.coupling, labellings


def best_labellings(field: Field, tolerance: float = 1e-9) -> np.ndarray:
    """Return all labellings (k, m) of highest score."""
    scores, labellings = enumerate_field(field)
    return labellings[scores >= scores.max() - tolerance]


def slow_differences(field: Field) -> np.ndarray:
    """Return best score with each patch suspicious minus best score with it plausible."""
    scores, labellings = enumerate_field(field)
    return np.array([scores[column > 0].max() - scores[column < 0].max() for column in labellings.T])


def _scaled(scaling: Scaling, name: str, raw: float) -> float:
    index = scaling.names.index(name)
    value = (raw - float(scaling.median[index])) / float(scaling.scale[index])
    return min(max(value, -scaling.clip), scaling.clip)


def tree_differences(field: Field) -> np.ndarray:
    """Return the differences of min-marginals of a tree whose pairs are (parent, child), parents before children.

    By messages up and down (max-product, exact on a tree): each the best score of a side, by the label beside it.
    """
    coupling = dict(zip(map(tuple, field.pairs.tolist()), field.coupling.tolist(), strict=True))
    parent = {child: above for above, child in coupling}
    n_patches = len(field.theta)
    up = np.zeros((n_patches, 2))  # of what hangs on a patch, by the label of its parent
    below = np.zeros((n_patches, 2))  # of a patch and all that hangs on it, by its own label
    own = np.column_stack([-field.theta, field.theta])
    for patch in range(n_patches - 1, -1, -1):
        below[patch] += own[patch]
        if patch in parent:
            up[patch] = _message(below[patch], coupling[parent[patch], patch])
            below[parent[patch]] += up[patch]
    best = below.copy()
    for patch in range(1, n_patches):
        above = best[parent[patch]] - up[patch]
        best[patch] += _message(above, coupling[parent[patch], patch])
    return best[:, 1] - best[:, 0]


def _message(score: np.ndarray, coupling: float) -> np.ndarray:
    """Return the best score (2,) over a pair by the label of its other end."""
    return np.maximum(score + coupling, score[::-1] - coupling)


def local_log_odds(features: PatchFeatures, model: Model, label: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the log-odds (m,) of each patch being suspicious, given the labels (m,) of all others, in nats."""
    field = make_field(model_inputs(features, model), model.edge_model, model.weights)
    y = np.where(label == SUSPICIOUS, 1.0, -1.0)
    found = 2.0 * field.theta
    for (first, second), coupling in zip(field.pairs.tolist(), field.coupling.tolist(), strict=True):
        found[first] += 2.0 * coupling * y[second]
        found[second] += 2.0 * coupling * y[first]
    return found
