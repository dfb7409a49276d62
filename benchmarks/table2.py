"""The experiment of the second paper again, on simulated maps: its table 2 beside ours, and how many labels are needed.

Each row trains on whole regions of labelled patches drawn from six maps and is scored on four maps of other seeds.
"paper-literal" measures by the equations as printed (`benchmarks.literal`); "nodes only" has no pairs, which shows what
these are worth. The fields that say when and from where points were seen are taken away, as the paper's map had
none, but for the row that says so. About five minutes; `python -m benchmarks.table2 --json` prints all numbers.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from benchmarks.drawn_labels import draw_labels
from benchmarks.literal import measure_by
from mapq.configuration import FeatureSettings, SimulateSettings, TrainSettings
from mapq.crf import classify
from mapq.crf.cross_validation import train
from mapq.crf.train import TrainingMap
from mapq.features.disagreement import PASS, SCAN, TIME, TO_SENSOR
from mapq.features.table import PatchFeatures
from mapq.patches import Patches, label_from_field
from mapq.results.evaluate import Scores, score_labels
from mapq.segmentation import segment
from mapq.simulate import simulate
from mapq.training import N_REGIONS, region_size, regions_of

TRAIN_SEEDS = (1, 2, 3, 4, 5, 6)
TEST_SEEDS = (15, 16, 17, 18)
"""Of maps that no choice of the method was made on: 11 to 14 were looked at while it grew."""
DRAWS = 5
"""Draws of training regions a row is averaged over: 150 patches of one place may not be like those of another."""
FEW, MANY = 150, 2000

PAPER = {"accuracy": 0.8042, "precision_plausible": 0.9418, "precision_suspicious": 0.6551, "f1": 0.763, "mcc": 0.628}
"""Table 2 of the paper, and what follows from its unique integer counts 648/40/219/416."""


class Row(NamedTuple):
    """One way to measure patches and to train."""

    name: str
    features: FeatureSettings | None  # None: the equations as printed
    settings: TrainSettings
    # whether maps keep the fields that say when and from where their points were seen
    passes: bool = False


PLAIN = FeatureSettings(context=())
ROWS = (
    Row("paper-literal", None, TrainSettings(edge_model="symmetric")),
    Row("safe, symmetric", PLAIN, TrainSettings(edge_model="symmetric")),
    Row("nodes only", PLAIN, TrainSettings(edge_model="none")),
    Row("paper's 4 neighbours", FeatureSettings(watched=0, context=()), TrainSettings()),
    Row("without context", PLAIN, TrainSettings()),
    Row("default", FeatureSettings(), TrainSettings()),
    Row("default, unweighted", FeatureSettings(), TrainSettings(class_weight="none")),
    Row("default, max-margin", FeatureSettings(), TrainSettings(objective="max-margin")),
    Row("default, passes known", FeatureSettings(), TrainSettings(), True),
)


def make_map(seed: int, settings: SimulateSettings | None = None) -> Patches:
    """Simulate, segment and label the map of a seed."""
    patches = segment(simulate(settings or SimulateSettings(), seed))
    return label_from_field(patches, "truth", f"seed {seed}")[0]


def without_passes(patches: Patches) -> Patches:
    """Return the patches without the fields that say when and from where their points were seen."""
    reported = (SCAN, TIME, PASS, *TO_SENSOR)
    kept = {name: values for name, values in patches.cloud.fields.items() if name not in reported}
    return dataclasses.replace(patches, cloud=dataclasses.replace(patches.cloud, fields=kept))


def seen(row: Row, maps: Sequence[Patches]) -> list[Patches]:
    """Return the maps as a row has them."""
    return list(maps) if row.passes else [without_passes(patches) for patches in maps]


def run(row: Row, train_maps: Sequence[Patches], test_maps: Sequence[Patches], n_most: int) -> dict[str, Any]:
    """Return mean and extremes of the scores of a row over draws of training regions, and the last model's weights."""
    trained_on = [measure_by(patches, row.features) for patches in seen(row, train_maps)]
    tested_on = [measure_by(patches, row.features) for patches in seen(row, test_maps)]
    scores, model = [], None
    for draw in range(DRAWS):
        labels = draw_labels(train_maps, n_most, draw)
        regions = regions_of(train_maps, labels, region_size(labels, N_REGIONS))
        maps = [TrainingMap(*each) for each in zip(trained_on, labels, regions, strict=True)]
        model = train(maps, row.settings).model
        scores.append(score(model, tested_on, test_maps))
    assert model is not None
    weights = dict(zip(model.parameter_names, model.weights.tolist(), strict=True))
    return {"n_train": n_most, "scores": [each._asdict() for each in scores], "weights": weights}


def score(model: Any, features: Sequence[PatchFeatures], maps: Sequence[Patches]) -> Scores:
    """Return the scores over all patches of all maps."""
    found = [classify(each, model) for each in features]
    return score_labels(
        np.concatenate([each.label for each in found]),
        np.concatenate([patches.label for patches in maps]),
        np.concatenate([each.probability for each in found]),
    )


def line(name: str, result: dict[str, Any]) -> str:
    """Return one line of the table."""
    mean = {key: float(np.mean([each[key] for each in result["scores"]])) for key in ("accuracy", "f1", "mcc", "auc")}
    worst = {key: float(np.min([each[key] for each in result["scores"]])) for key in ("accuracy", "f1")}
    confusion = np.mean([each["confusion"] for each in result["scores"]], axis=0)
    rows = confusion / np.maximum(confusion.sum(axis=1, keepdims=True), 1)
    return (
        f"{name:22}{result['n_train']:>7}{mean['accuracy']:>10.3f} ({worst['accuracy']:.3f}){mean['f1']:>8.3f}"
        f" ({worst['f1']:.3f}){mean['mcc']:>8.3f}{rows[0, 0]:>11.3f}{rows[1, 1]:>12.3f}{mean['auc']:>8.3f}"
    )


def main() -> None:
    """Run all rows and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    as_json = parser.parse_args().json
    train_maps, test_maps = [make_map(seed) for seed in TRAIN_SEEDS], [make_map(seed) for seed in TEST_SEEDS]
    truth = np.concatenate([patches.label for patches in test_maps])
    results = {(row.name, n): run(row, train_maps, test_maps, n) for n in (FEW, MANY) for row in ROWS}
    if as_json:
        rows = [
            {"name": name, "features": r.features and r.features.stored(), **results[name, n]}
            for name, n in results
            for r in ROWS
            if r.name == name
        ]
        print(json.dumps({"paper": PAPER, "n_test": len(truth), "suspicious": float(truth.mean()), "rows": rows}))
        return
    print(f"{len(truth)} patches of {len(test_maps)} maps never trained on, {truth.mean():.1%} suspicious")
    print("mean over draws of the training regions (worst draw); plausible, suspicious: rows of table 2")
    print(f"{'':22}{'labels':>7}{'accuracy':>18}{'F1':>16}{'MCC':>8}{'plausible':>11}{'suspicious':>12}{'AUC':>8}")
    print(
        f"{'the paper, its map':22}{FEW:>7}{PAPER['accuracy']:>10.3f}        {PAPER['f1']:>8.3f}        "
        f"{PAPER['mcc']:>8.3f}{PAPER['precision_plausible']:>11.3f}{PAPER['precision_suspicious']:>12.3f}"
    )
    for (name, _), result in results.items():
        print(line(name, result))
    print("weights on the standardised scale, default:")
    for name, weight in results["default", MANY]["weights"].items():
        print(f"  {name:28}{weight:8.3f}")


if __name__ == "__main__":
    main()
