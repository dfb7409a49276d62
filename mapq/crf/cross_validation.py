"""The strength of the regularisation, the calibration and the operating points, by cross-validation over regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import TrainSettings
from mapq.crf.calibration import choose_calibration, fit_temperature, log_loss, operating_points
from mapq.crf.energy import make_field
from mapq.crf.graph_cut import solve
from mapq.crf.pseudo_likelihood import objective
from mapq.crf.train import (
    Prepared,
    Strength,
    TrainingMap,
    fit_weights,
    make_problem,
    patch_weights,
    prepare,
    require_labels,
    signs,
)
from mapq.crf.trees import KNOWS_SCANS, add_evidence, columns_of, evidence_of, grow, without_scans
from mapq.labels import SUSPICIOUS, UNLABELLED
from mapq.model import NONE, Calibration, Columns, Model, Potential

STRENGTHS = (1.0, 10.0)
"""Regularisation strengths that are tried; held-out scores hardly depend on them."""
COUPLING_SHARES = (0.015, 0.05, 0.15, 0.5, 1.5, 1e3)
"""Strengths of the coupling that are tried with each of them, per labelled patch; the last leaves no coupling.

They grow with the patches, as pseudo-likelihood trusts neighbours too much however many there are: it knows their
labels when it trains, and they are to be found when it is used.
"""
MARGIN_STRENGTHS = (1.0, 10.0, 100.0)
"""Strengths that are tried for maximum margin, of all weights alike: it trains on the labellings that cuts find, as
they are used, and trusts the coupling no more than it should."""


class HeldOut(NamedTuple):
    """What models infer about patches on which they were not trained."""

    truth: NDArray[np.uint8]  # (n,)
    label: NDArray[np.uint8]  # (n,)
    # (n,) of being suspicious, by a calibration that had not seen the patch's fold either
    probability: NDArray[np.float64]
    calibrations: dict[str, float]  # kind of calibration to log-loss on folds that it had not seen, in nats


class Trained(NamedTuple):
    """A model and how it was chosen."""

    model: Model  # without feature settings and training summary, which the caller knows
    strength: Strength
    # strength to mean held-out log-loss, in nats; empty where there was no cross-validation
    scores: dict[Strength, float]
    held_out: HeldOut | None  # of the chosen strength; None where there was no cross-validation
    n_folds: int  # 0 where there was no cross-validation
    pseudo_log_likelihood: float  # mean log-probability of a training label given all others, in nats
    # column of the trees to how far it moves log-odds in the mean over the maps, in nats; empty without trees
    importance: dict[str, float]


class _Trial(NamedTuple):
    """Held-out patches as models of one strength see them."""

    y: NDArray[np.float64]
    label: NDArray[np.uint8]
    difference: NDArray[np.float64]
    fold: NDArray[np.int64]
    temperature: Calibration

    @property
    def score(self) -> float:
        return log_loss(self.difference, self.y, self.temperature)

    @property
    def error(self) -> float:
        """Standard error of the score, as if patches were independent."""
        losses = np.logaddexp(0.0, -self.y * self.temperature.log_odds(self.difference))
        return float(losses.std() / np.sqrt(len(losses)))


def train(maps: Sequence[TrainingMap], settings: TrainSettings | None = None) -> Trained:
    """Return the model of maximum pseudo-likelihood, or margin, over all maps.

    Each fold leaves out whole regions: their labels are hidden, the rest trains, and a graph cut labels them with no
    label given, as it will on a new map. Of the strengths whose held-out log-loss is within a standard error of the
    least, the one with the least coupling is taken. The calibration is fitted to what its models infer for their folds.
    The scaling is that of all patches: it sees no label.

    Raises InputError if no patch has a label, or all have the same.
    """
    settings = settings or TrainSettings()
    require_labels(maps)
    folds = _usable_folds(maps, settings.folds)
    potential, importance = None, dict[str, float]()
    if settings.potential == "trees":
        columns = [columns_of(each.features, each.tolerance) for each in maps]
        maps, folds, potential = with_trees(maps, columns, folds, settings)
        importance = potential.importance(columns)
        importance.pop(KNOWS_SCANS, None)
    prepared = prepare(maps, settings)
    labels = [training_map.label for training_map in maps]
    n_labelled = sum(int(np.count_nonzero(label != UNLABELLED)) for label in labels)
    strengths = _strengths(settings, n_labelled) if folds else []
    trials = {strength: _try(prepared, labels, folds, settings, strength) for strength in strengths}
    scores = {strength: trial.score for strength, trial in trials.items()}
    # Without a cross-validation differences are taken for log-odds.
    chosen = (
        _choose(trials)
        if trials
        else Strength(settings.regularisation or 1.0, settings.coupling_regularisation or 30.0)
    )
    trial = trials.get(chosen)
    weights = fit_weights(prepared, labels, settings, chosen)
    model = Model(settings.edge_model, {}, prepared.node, prepared.x_range, weights, potential=potential)
    model = replace(model, tolerances=tuple(sorted({each.tolerance for each in maps})))
    held_out = None
    if trial is not None:
        calibrated = choose_calibration(trial.difference, trial.y, trial.label, trial.fold)
        points = operating_points(trial.difference, trial.y)
        model = replace(model, calibration=calibrated.calibration, operating=points)
        truth = (trial.y > 0.0).astype(np.uint8)
        held_out = HeldOut(truth, trial.label, calibrated.probability, calibrated.losses)
    plain = make_problem(prepared, labels, settings.replace(class_weight="none"), Strength(0.0, 0.0))
    likelihood = -objective(plain, weights) / len(plain.y)
    return Trained(model, chosen, scores, held_out, len(folds), likelihood, importance)


def with_trees(
    maps: Sequence[TrainingMap],
    columns: Sequence[Columns],
    folds: Sequence[Sequence[NDArray[np.bool_]]],
    settings: TrainSettings,
) -> tuple[list[TrainingMap], list[list[NDArray[np.bool_]]], Potential]:
    """Return the maps with the evidence of trees that did not see the fold of a patch, their folds, and the trees.

    Trees overfit their own training patches, and the field would trust them too much. Each map
    whose scans are known counts twice, the second time as if they were not: most maps are of that kind. What points
    alone do not tell surely they tell in part, so trees learn from it; field and calibration do not.
    """
    bare = [without_scans(each) for each in columns]
    twice = [
        number
        for number in range(len(maps))
        if not np.array_equal(columns[number].values, bare[number].values, equal_nan=True)
    ]
    sources = [*maps, *(maps[number].of_points_alone() for number in twice)]
    seen = [*columns, *(bare[number] for number in twice)]
    labels = [signs(maps[number].label) for number in (*range(len(maps)), *twice)]
    left_out = [[*fold, *(fold[number] for number in twice)] for fold in folds]
    weights = patch_weights(labels, settings.class_weight == "balanced")
    potential = grow(seen, labels, weights)
    evidence = [evidence_of(each, potential) for each in seen]
    for hidden_ones in left_out:
        visible = [np.where(hidden, 0.0, label) for hidden, label in zip(hidden_ones, labels, strict=True)]
        outside = grow(seen, visible, weights)
        for found, hidden, each in zip(evidence, hidden_ones, seen, strict=True):
            if hidden.any():
                found[hidden] = evidence_of(each, outside)[hidden]
    features = [
        each._replace(features=add_evidence(each.features, found))
        for each, found in zip(sources, evidence, strict=True)
    ]
    masks = [
        [hidden & (each.label != UNLABELLED) for hidden, each in zip(hidden_ones, sources, strict=True)]
        for hidden_ones in left_out
    ]
    return features, masks, potential


def _strengths(settings: TrainSettings, n_labelled: int) -> list[Strength]:
    """Return the strengths to try; what the settings give is not varied, nor the coupling where there is none."""
    margin = settings.objective == "max-margin"
    usual = MARGIN_STRENGTHS if margin else STRENGTHS[: 1 if settings.potential == "trees" else None]
    tried = usual if settings.regularisation is None else (settings.regularisation,)
    if settings.edge_model == NONE:
        return [Strength(weights, weights) for weights in tried]
    if settings.coupling_regularisation is not None:
        return [Strength(weights, settings.coupling_regularisation) for weights in tried]
    if margin:
        return [Strength(weights, weights) for weights in tried]
    return [Strength(weights, share * n_labelled) for weights in tried for share in COUPLING_SHARES]


def _choose(trials: Mapping[Strength, _Trial]) -> Strength:
    """Return the strength with the least coupling that scores as well as the best, to within its standard error.

    With few labels the best score is half luck, and too much coupling is the costlier mistake: it lets one wrong label
    spread over a map.
    """
    best = min(trials.values(), key=lambda trial: trial.score)
    limit = best.score + best.error
    good = [strength for strength, trial in trials.items() if trial.score <= limit]
    most = max(strength.coupling for strength in good)
    return min((s for s in good if s.coupling == most), key=lambda s: (trials[s].score, -s.weights))


def _usable_folds(maps: Sequence[TrainingMap], n_folds: int) -> list[list[NDArray[np.bool_]]]:
    """Return for each fold the labelled patches (m,) of each map that it leaves out.

    A fold without which only one label is left cannot be trained on and is passed over.
    """
    known = [training_map.label != UNLABELLED for training_map in maps]
    regions = [training_map.region[labelled] for training_map, labelled in zip(maps, known, strict=True)]
    labels = np.concatenate([m.label[labelled] for m, labelled in zip(maps, known, strict=True)])
    _, region = np.unique(np.concatenate(regions), return_inverse=True)
    fold = assign_folds(region, labels == SUSPICIOUS, n_folds)
    ends = np.cumsum([np.count_nonzero(labelled) for labelled in known])[:-1]
    usable = []
    for index in np.unique(fold):
        if len(np.unique(labels[fold != index])) == 2:
            masks = [labelled.copy() for labelled in known]
            for mask, part in zip(masks, np.split(fold == index, ends), strict=True):
                mask[mask] = part
            usable.append(masks)
    return usable


def _try(
    prepared: Prepared,
    labels: Sequence[NDArray[np.uint8]],
    folds: Sequence[Sequence[NDArray[np.bool_]]],
    settings: TrainSettings,
    strength: Strength,
) -> _Trial:
    """Return what models trained without each fold infer about it."""
    y, found, differences, numbers = [], [], [], []
    for number, held_out in enumerate(folds):
        visible = [np.where(mask, UNLABELLED, label) for mask, label in zip(held_out, labels, strict=True)]
        weights = fit_weights(prepared, visible, settings, strength)
        for inputs, mask, label in zip(prepared.inputs, held_out, labels, strict=True):
            if mask.any():
                cut = solve(make_field(inputs, settings.edge_model, weights), mask)
                y.append(signs(label[mask]))
                found.append(cut.label[mask])
                differences.append(cut.difference[mask])
                numbers.append(np.full(int(mask.sum()), number))
    truth, difference = np.concatenate(y), np.concatenate(differences)
    temperature = fit_temperature(difference, truth)
    return _Trial(truth, np.concatenate(found), difference, np.concatenate(numbers), temperature)


def split_regions(centroid: NDArray[np.float64], max_patches: int) -> NDArray[np.int64]:
    """Return the region (m,) of each patch: the map halved at medians across its longer side.

    `centroid` (m, 3): metres. `max_patches`: regions are halved until they have no more.
    """
    region = np.zeros(len(centroid), np.int64)
    pending, n_regions = [np.arange(len(centroid))], 0
    while pending:
        members = pending.pop()
        if len(members) > max(max_patches, 1):
            spread = np.ptp(centroid[members], axis=0)
            order = members[np.argsort(centroid[members, int(spread.argmax())], kind="stable")]
            pending += [order[len(order) // 2 :], order[: len(order) // 2]]
            continue
        region[members] = n_regions
        n_regions += 1
    return region


def assign_folds(region: NDArray[np.int64], suspicious: NDArray[np.bool_], n_folds: int) -> NDArray[np.int64]:
    """Return the fold (n,) of each patch: whole regions, dealt so that folds have alike many patches of either label.

    Regions are dealt largest first, each to the fold that has least of what the region has, the smallest of equals.

    `region` (n,): numbers from 0, each map's its own. `suspicious` (n,). `n_folds`: at most; fewer if there are fewer
    regions.
    """
    n_regions = int(region.max()) + 1 if len(region) else 0
    counts = np.column_stack([np.bincount(region[kind], minlength=n_regions) for kind in (suspicious, ~suspicious)])
    shares = counts / np.maximum(counts.sum(axis=0), 1)
    loads = np.zeros((max(1, min(n_folds, n_regions)), 2))
    fold_of = np.zeros(n_regions, np.int64)
    for index in np.lexsort((np.arange(n_regions), -shares.sum(axis=1))).tolist():
        overlap = np.round(loads @ shares[index], 12)
        fold = int(np.lexsort((np.arange(len(loads)), loads.sum(axis=1), overlap))[0])
        fold_of[index] = fold
        loads[fold] += shares[index]
    return fold_of[region]
