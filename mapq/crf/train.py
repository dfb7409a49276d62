"""Training over several maps, some of whose patches may have no label: what is fitted, and how strongly."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import TrainSettings
from mapq.crf.energy import Inputs, label_design, make_inputs, node_columns, require_finite, unary_design
from mapq.crf.max_margin import GAP, fit_margin, make_part
from mapq.crf.pseudo_likelihood import Problem, fit
from mapq.features.table import PatchFeatures
from mapq.labels import LABEL_TOLERANCE, SUSPICIOUS, UNLABELLED
from mapq.model import CLIP, EVIDENCE, NONE, Scaling
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

LARGEST_EVIDENCE = 12.0
"""Nats: log-odds of the trees are cut here; no patch is so sure."""
RELATIVE_FLOOR = 1e-9
"""A column that varies by less than this share of its size is constant but for rounding."""


class TrainingMap(NamedTuple):
    """A map with labels; one for each tolerance at which there are any."""

    features: PatchFeatures
    label: NDArray[np.uint8]  # (m,) `PLAUSIBLE`, `SUSPICIOUS` or `UNLABELLED`, at its tolerance
    # (m,) part of the map that a patch is in, numbered from 0 over all maps: cross-validation keeps regions whole
    region: NDArray[np.int64]
    tolerance: float = LABEL_TOLERANCE  # metres
    # (m,) patches so close below the tolerance that points alone do not tell; None: none
    between: NDArray[np.bool_] | None = None

    def of_points_alone(self) -> TrainingMap:
        """Return the map without the labels that points alone do not tell."""
        if self.between is None:
            return self
        return self._replace(label=np.where(self.between, np.uint8(UNLABELLED), self.label))


class Strength(NamedTuple):
    """How strongly weights are drawn to 0: precisions of their Gaussian priors.

    Pseudo-likelihood sees the true labels of neighbours, which inference does not, and so trusts the coupling too much:
    it has a strength of its own.
    """

    weights: float
    coupling: float


class Prepared(NamedTuple):
    """Maps in the form that the weights are linear in."""

    node: Scaling
    x_range: tuple[float, float]
    inputs: list[Inputs]
    unary: list[NDArray[np.float64]]  # (m, p) :func:`mapq.crf.energy.unary_design`; they depend on no label


def prepare(maps: Sequence[TrainingMap], settings: TrainSettings) -> Prepared:
    """Return the standardisation of all patches of the maps, labelled or not, and the maps in it.

    Raises InputError if a feature is not finite, or a map lacks a feature that another has.
    """
    for training_map in maps:
        require_finite(training_map.features)
    with_trees = settings.potential == "trees"
    node_names = maps[0].features.node_names
    x_range = fit_range(np.concatenate([m.features.plausibility for m in maps]))
    if with_trees:
        node = Scaling((EVIDENCE,), np.zeros(1), np.ones(1), LARGEST_EVIDENCE)
    else:
        node = fit_scaling(np.vstack([node_columns(m.features, node_names) for m in maps]), node_names)
    inputs = [make_inputs(m.features, settings.edge_model, node, x_range, with_trees) for m in maps]
    return Prepared(node, x_range, inputs, [unary_design(each) for each in inputs])


def signs(label: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return labels (m,) as +1 suspicious, -1 plausible, 0 without."""
    y = np.where(label == SUSPICIOUS, 1.0, -1.0)
    return np.where(label == UNLABELLED, 0.0, y)


def patch_weights(signed: Sequence[NDArray[np.float64]], balanced: bool) -> list[NDArray[np.float64]]:
    """Return how much the labelled patches (m,) of each map weigh: both labels alike, or every patch; 0 without."""
    y = np.concatenate(signed)
    shares = (float(np.mean(y[y != 0.0] == sign)) if balanced else 0.5 for sign in (1.0, -1.0))
    suspicious, plausible = (max(share, 1e-300) for share in shares)
    return [np.select([y > 0.0, y < 0.0], [0.5 / suspicious, 0.5 / plausible], 0.0) for y in signed]


def make_problem(
    prepared: Prepared, labels: Sequence[NDArray[np.uint8]], settings: TrainSettings, strength: Strength
) -> Problem:
    """Return the training problem of the patches that have a label.

    A patch without a label has no term of its own. As a neighbour it counts as label 0, half way between both: the
    coupling with it drops out. That keeps the objective convex, which summing over the labels it could have would not.
    """
    signed = [signs(label) for label in labels]
    rows = [
        np.hstack([unary, label_design(inputs, settings.edge_model, y)])
        for inputs, unary, y in zip(prepared.inputs, prepared.unary, signed, strict=True)
    ]
    y, importance = np.concatenate(signed), np.concatenate(patch_weights(signed, settings.class_weight == "balanced"))
    n_unary, n_weights = prepared.unary[0].shape[1], rows[0].shape[1]
    precision = precisions(n_unary, settings.edge_model, strength)
    known = y != 0.0
    return Problem(np.vstack(rows)[known], y[known], importance[known], precision, tuple(range(n_unary, n_weights)))


def fit_weights(
    prepared: Prepared, labels: Sequence[NDArray[np.uint8]], settings: TrainSettings, strength: Strength
) -> NDArray[np.float64]:
    """Return the weights of least objective, regularised, in the order of the model's parameter names."""
    if settings.objective == "max-margin":
        return margin_weights(prepared, labels, settings, strength)
    return fit(make_problem(prepared, labels, settings, strength))


def margin_weights(
    prepared: Prepared, labels: Sequence[NDArray[np.uint8]], settings: TrainSettings, strength: Strength
) -> NDArray[np.float64]:
    """Return the weights of maximum margin; a wrong label costs what the patch weighs in the pseudo-likelihood."""
    signed = [signs(label) for label in labels]
    costs = patch_weights(signed, settings.class_weight == "balanced")
    parts = [make_part(*each) for each in zip(prepared.inputs, prepared.unary, signed, costs, strict=True)]
    precision = precisions(prepared.unary[0].shape[1], settings.edge_model, strength)
    found = fit_margin([part for part in parts if len(part.y)], settings.edge_model, precision)
    if found.bound < (1.0 - GAP) * found.objective:
        logger.warning("maximum margin: %d rounds were not enough; the optimum may be better", found.n_rounds)
    return found.weights


def precisions(n_unary: int, edge_model: str, strength: Strength) -> NDArray[np.float64]:
    """Return the precision of each weight's prior, given how many weights theta has; the bias of nodes has none."""
    n_coupling = 0 if edge_model == NONE else 2
    precision = np.repeat([strength.weights, strength.coupling], [n_unary, n_coupling])
    precision[0] = 0.0
    return precision


def require_labels(maps: Sequence[TrainingMap]) -> None:
    """Raise InputError unless there are labels of both kinds."""
    labels = np.concatenate([m.label for m in maps]) if maps else np.empty(0, np.uint8)
    labels = labels[labels != UNLABELLED]
    if len(labels) == 0:
        raise InputError("no patch has a label. Label some with: mapq label PATCHES --from-field NAME")
    if len(np.unique(labels)) == 1:
        only = "suspicious" if labels[0] == SUSPICIOUS else "plausible"
        raise InputError(f"all {len(labels)} labelled patches are {only}. Label patches of both kinds, or add a map.")


def fit_scaling(values: NDArray[np.float64], names: tuple[str, ...]) -> Scaling:
    """Return the standardisation of columns (n, k).

    The scale is the interquartile range, but at least so large that the clip cuts no more than one value in a hundred
    on either side: most pairs of a good map have the same x_ij, and the few others are the ones that matter. A
    constant column gets scale 1.
    """
    if values.size == 0:
        return Scaling(names, np.zeros(len(names)), np.ones(len(names)))
    # Of a column that is not known at all anything will do: it is 0 once standardised.
    values = np.where(np.isnan(values).all(axis=0), 0.0, values)
    low, quarter, median, three_quarters, high = np.nanquantile(values, (0.01, 0.25, 0.5, 0.75, 0.99), axis=0)
    reach = np.maximum(high - median, median - low) / CLIP
    scale = np.maximum(three_quarters - quarter, reach)
    constant = scale <= RELATIVE_FLOOR * np.maximum(np.abs(median), RELATIVE_FLOOR)
    return Scaling(names, median, np.where(constant, 1.0, scale))


def fit_range(x: NDArray[np.float64]) -> tuple[float, float]:
    """Return the range of x_ij (n,): what was seen, but not beyond the clip of its standardisation."""
    if len(x) == 0:
        return 0.0, 0.0
    scaling = fit_scaling(x[:, None], ("x",))
    median, reach = float(scaling.median[0]), CLIP * float(scaling.scale[0])
    return max(float(x.min()), median - reach), min(float(x.max()), median + reach)
