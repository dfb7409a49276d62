"""The ways to label patches that `benchmarks.real_maps` compares, and their scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np

from mapq.assess import feature_settings
from mapq.crf import TrainingMap, TrainSettings, classify, train
from mapq.evaluate import Scores, score_labels
from mapq.features import FeatureSettings, patch_features
from mapq.io.models import read_default_model
from mapq.labels import label_from_field
from mapq.model import Model
from mapq.patches import PLAUSIBLE, SUSPICIOUS, UNLABELLED, Patches
from mapq.segment import segment
from mapq.simulate import Settings, simulate
from mapq.training import N_REGIONS, region_size, regions_of

SIMULATED = ((101, 0.010, 1.0), (104, 0.030, 1.0), (109, 0.050, 1.5), (111, 0.030, 0.0))
"""Seed, noise and drift of the simulated maps that rivals are trained on: some of the shipped model's, thinned."""
N_POINTS = 300_000
SHIPPED = "shipped model"
MAJORITY = "majority"


class Method(NamedTuple):
    """How features are read and weights are trained."""

    features: FeatureSettings
    settings: TrainSettings


METHODS = {
    "nodes only": Method(FeatureSettings(), TrainSettings(edge_model="none", edge_features=(), balanced=False)),
    "paper-literal": Method(
        FeatureSettings(reading="literal"), TrainSettings(edge_model="symmetric", edge_features=(), balanced=False)
    ),
    "default": Method(FeatureSettings(), TrainSettings(balanced=False)),
}


class Labels(NamedTuple):
    """What a method says of patches: label (m,), probability (m,)."""

    label: np.ndarray
    probability: np.ndarray


def simulated_maps() -> list[Patches]:
    """Return labelled patches of simulated maps."""
    maps = []
    for seed, noise, drift in SIMULATED:
        settings = Settings(n_points=N_POINTS, noise=noise, drift=drift, disagreement=max(0.05, 3.3 * noise))
        maps.append(label_from_field(segment(simulate(settings, seed)), "truth", f"seed {seed}")[0])
    return maps


def train_on(maps: Sequence[Patches], name: str) -> Model:
    """Return a model of a method, regularised by cross-validation over regions of the maps."""
    method = METHODS[name]
    labels = [patches.label for patches in maps]
    regions = regions_of(maps, labels, region_size(labels, N_REGIONS))
    rows = zip(maps, labels, regions, strict=True)
    prepared = [TrainingMap(patch_features(p, method.features), label, region) for p, label, region in rows]
    return replace(train(prepared, method.settings).model, features=asdict(method.features))


def models_from_simulation() -> dict[str, Model]:
    """Return the shipped model, and its rivals trained on simulated maps too."""
    maps = simulated_maps()
    rivals = {f"{name}, simulated": train_on(maps, name) for name in ("nodes only", "paper-literal")}
    return {SHIPPED: read_default_model(), **rivals}


def say(patches: Patches, model: Model) -> Labels:
    """Return what a model says of patches."""
    if len(patches) == 0:
        return Labels(np.zeros(0, np.uint8), np.zeros(0))
    found = classify(patch_features(patches, feature_settings(model)), model)
    return Labels(found.label, found.probability.astype(np.float64))


def score(models: dict[str, Model], maps: Sequence[Patches], prior: Sequence[Patches] | None) -> dict[str, Scores]:
    """Return the scores of models over all patches of maps; of the majority label of `prior`, or of the maps."""
    truth = np.concatenate([patches.label for patches in maps])
    known = np.concatenate([patches.label for patches in (prior or maps)])
    share = float(np.mean(known[known != UNLABELLED] == SUSPICIOUS))
    guess = np.full(len(truth), SUSPICIOUS if share > 0.5 else PLAUSIBLE, np.uint8)
    found = {MAJORITY: score_labels(guess, truth, np.full(len(truth), share))}
    for name, model in models.items():
        said = [say(patches, model) for patches in maps]
        label, probability = (np.concatenate([getattr(each, part) for each in said]) for part in Labels._fields)
        found[name] = score_labels(label, truth, probability)
    return found


def table(scores: dict[str, Scores]) -> list[str]:
    """Return the lines of a table of scores."""
    first = next(iter(scores.values()))
    head = f"{first.n} patches, {first.base_rate:.1%} suspicious, {first.n_without_truth} without truth left out"
    columns = ("accuracy", "f1", "mcc", "auc", "ece", "recall", "specificity")
    lines = [head, f"{'':28}" + "".join(f"{name:>12}" for name in columns)]
    for name, row in scores.items():
        lines.append(f"{name:28}" + "".join(f"{number(getattr(row, column)):>12}" for column in columns))
    return lines


def number(value: float) -> str:
    """Return a score with three digits, a dash where it is not defined."""
    return "-" if value != value else f"{value:.3f}"


def share_called(patches: Sequence[Patches], model: Model) -> dict[str, Any]:
    """Return how many patches a model calls suspicious."""
    labels = [say(each, model).label for each in patches]
    bad, total = sum(int(np.count_nonzero(label == SUSPICIOUS)) for label in labels), sum(map(len, labels))
    return {"suspicious": bad, "patches": total, "share": bad / total if total else float("nan")}
