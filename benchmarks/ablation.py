"""What each part of `mapq` is worth: features, edge model, training objective, one left out or changed at a time.

The experiment of `benchmarks.table2` at 2,000 labels: trained on regions of six simulated maps, scored on four others,
mean over five draws. Maps keep the fields that say when and from where points were seen, but for the rows that say so.
Some five minutes; `python -m benchmarks.ablation --json` prints all numbers.
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from benchmarks.table2 import MANY, PLAIN, TEST_SEEDS, TRAIN_SEEDS, Row, line, make_map, run
from mapq.configuration import CONTEXTS, FeatureSettings, TrainSettings

ALL = FeatureSettings()

ROWS = (
    Row("everything", ALL, TrainSettings(), True),
    *(
        Row(f"without {name}", FeatureSettings(context=tuple(c for c in CONTEXTS if c != name)), TrainSettings(), True)
        for name in CONTEXTS
    ),
    Row("no passes known", ALL, TrainSettings()),
    Row("no context", PLAIN, TrainSettings()),
    Row("not watched", FeatureSettings(watched=0), TrainSettings(), True),
    Row("literal features", None, TrainSettings(), True),
    Row("no edges", ALL, TrainSettings(edge_model="none"), True),
    Row("max-margin", ALL, TrainSettings(objective="max-margin"), True),
    Row("unweighted", ALL, TrainSettings(class_weight="none"), True),
    Row("  max-margin", ALL, TrainSettings(class_weight="none", objective="max-margin"), True),
)


def main() -> None:
    """Run all rows and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    as_json = parser.parse_args().json
    train_maps, test_maps = [make_map(seed) for seed in TRAIN_SEEDS], [make_map(seed) for seed in TEST_SEEDS]
    truth = np.concatenate([patches.label for patches in test_maps])
    if not as_json:
        print(f"{len(truth)} patches of {len(test_maps)} maps never trained on, {truth.mean():.1%} suspicious")
        print(
            f"{'':22}{'labels':>7}{'accuracy':>18}{'F1':>16}{'MCC':>8}{'plausible':>11}{'suspicious':>12}{'AUC':>8}",
            flush=True,
        )
    results = {}
    for row in ROWS:
        results[row.name] = run(row, train_maps, test_maps, MANY)
        if not as_json:
            print(line(row.name, results[row.name]), flush=True)
    if as_json:
        print(json.dumps({"n_test": len(truth), "rows": results}))


if __name__ == "__main__":
    main()
