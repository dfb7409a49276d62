"""The ways to label patches that `benchmarks.real_maps` compares, and their scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.literal import measure_by
from mapq.configuration import FeatureSettings, SimulateSettings, TrainSettings
from mapq.crf import classify
from mapq.crf.cross_validation import train
from mapq.crf.train import TrainingMap
from mapq.features.compute import feature_settings
from mapq.io.models import read_default_model
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.model import Model
from mapq.patches import Patches, label_from_field
from mapq.results.evaluate import Scores, score_labels
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.training import N_REGIONS, region_size, regions_of

SIMULATED = ((101, 0.010, 1.0), (104, 0.030, 1.0), (109, 0.050, 1.5))
"""Seed, noise and drift of the simulated maps that rivals are trained on: some of the shipped model's, thinned."""
N_POINTS = 150_000
SHIPPED = "shipped model"
KNOWN = ", scans known"
"""Behind the name of a method that may use the fields which say when and from where points were seen."""
PROVENANCE = ("scan", "time", "pass_id", "to_sensor_x", "to_sensor_y", "to_sensor_z")
MAJORITY = "majority"


class Method(NamedTuple):
    """How patches are measured and weights are trained."""

    features: FeatureSettings | None  # None: the equations as printed
    settings: TrainSettings


METHODS = {
    "nodes only": Method(FeatureSettings(context=()), TrainSettings(edge_model="none", class_weight="none")),
    "paper-literal": Method(None, TrainSettings(edge_model="symmetric", class_weight="none")),
    "default": Method(FeatureSettings(), TrainSettings(class_weight="none")),
}


class Labels(NamedTuple):
    """What a method says of patches: label (m,), probability (m,)."""

    label: np.ndarray
    probability: np.ndarray


def simulated_maps() -> list[Patches]:
    """Return labelled patches of simulated maps."""
    maps = []
    for seed, noise, drift in SIMULATED:
        settings = SimulateSettings(n_points=N_POINTS, noise=noise, drift=drift, disagreement=max(0.05, 3.3 * noise))
        maps.append(label_from_field(segment(simulate(settings, seed)), "truth", f"seed {seed}")[0])
    return maps


def without_scans(patches: Patches) -> Patches:
    """Return patches of a map of which nobody knows when and from where it was seen."""
    fields = {name: values for name, values in patches.cloud.fields.items() if name not in PROVENANCE}
    return replace(patches, cloud=replace(patches.cloud, fields=fields))


def train_on(maps: Sequence[Patches], name: str) -> Model:
    """Return a model of a method, regularised by cross-validation over regions of the maps.

    It stores the settings of its features; none if they are the equations as printed.
    """
    method = METHODS[name.removesuffix(KNOWN)]
    maps = maps if name.endswith(KNOWN) else [without_scans(patches) for patches in maps]
    labels = [patches.label for patches in maps]
    regions = regions_of(maps, labels, region_size(labels, N_REGIONS))
    rows = zip(maps, labels, regions, strict=True)
    prepared = [TrainingMap(measure_by(p, method.features), label, region) for p, label, region in rows]
    stored = {} if method.features is None else method.features.stored()
    return replace(train(prepared, method.settings).model, features=stored)


def models_from_simulation() -> dict[str, Model]:
    """Return the shipped model without and with scans known, and its rivals trained on simulated maps too."""
    maps, shipped = simulated_maps(), read_default_model()
    rivals = {f"{name}, simulated": train_on(maps, name) for name in ("nodes only", "paper-literal")}
    return {SHIPPED: shipped, SHIPPED + KNOWN: shipped, **rivals}


def say(patches: Patches, name: str, model: Model) -> Labels:
    """Return the labels of patches by a model; its name shows whether it may use scans."""
    if len(patches) == 0:
        return Labels(np.zeros(0, np.uint8), np.zeros(0))
    patches = patches if KNOWN in name else without_scans(patches)
    settings = feature_settings(model) if model.features else None
    found = classify(measure_by(patches, settings), model)
    return Labels(found.label, found.probability.astype(np.float64))


def score(models: dict[str, Model], maps: Sequence[Patches], prior: Sequence[Patches] | None) -> dict[str, Scores]:
    """Return the scores of models over all patches of maps; of the majority label of `prior`, or of the maps."""
    truth = np.concatenate([patches.label for patches in maps])
    known = np.concatenate([patches.label for patches in (prior or maps)])
    share = float(np.mean(known[known != UNLABELLED] == SUSPICIOUS))
    guess = np.full(len(truth), SUSPICIOUS if share > 0.5 else PLAUSIBLE, np.uint8)
    found = {MAJORITY: score_labels(guess, truth, np.full(len(truth), share))}
    for name, model in models.items():
        said = [say(patches, name, model) for patches in maps]
        label, probability = (np.concatenate([getattr(each, part) for each in said]) for part in Labels._fields)
        found[name] = score_labels(label, truth, probability)
    return found


def table(scores: dict[str, Scores]) -> list[str]:
    """Return the lines of a table of scores."""
    first = next(iter(scores.values()))
    head = f"{first.n} patches, {first.base_rate:.1%} suspicious, {first.n_without_truth} without truth left out"
    columns = ("accuracy", "f1", "mcc", "auc", "ece", "recall", "specificity")
    lines = [head, f"{'':42}" + "".join(f"{name:>12}" for name in columns)]
    for name, row in scores.items():
        lines.append(f"{name:42}" + "".join(f"{number(getattr(row, column)):>12}" for column in columns))
    return lines


def number(value: float) -> str:
    """Return a score with three digits, a dash where it is not defined."""
    return "-" if value != value else f"{value:.3f}"


def share_called(patches: Sequence[Patches], name: str, model: Model) -> dict[str, Any]:
    """Return how many patches a model calls suspicious."""
    labels = [say(each, name, model).label for each in patches]
    bad, total = sum(int(np.count_nonzero(label == SUSPICIOUS)) for label in labels), sum(map(len, labels))
    return {"suspicious": bad, "patches": total, "share": bad / total if total else float("nan")}
