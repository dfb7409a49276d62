"""`mapq` on real maps: drifted and consistent ones, of known errors, and of pairs of scans.

Part 1: sub-maps of a business park, chained as odometry has them and each alone; trained and tested at different
places. Part 2: KITTI with published and with registered poses, and a pair of scans raw and registered. Part 3: the pair
protocol of CorAl and FACT. Graded errors on consistent scans are in `benchmarks.unseen`. Beside the default stand the
majority, patches alone (logistic regression), and the paper read literally. The data are public but not part of this
repository (`--data FOLDER`). About a quarter of an hour on one core.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import real_data, real_pairs
from benchmarks.real_methods import (
    KNOWN,
    METHODS,
    SHIPPED,
    models_from_simulation,
    score,
    share_called,
    table,
    train_on,
)
from benchmarks.split import split_by_place
from mapq.configuration import MergeSettings
from mapq.crf.calibration import with_false_alarms
from mapq.io.models import read_default_model
from mapq.model import Model
from mapq.patches import Patches
from mapq.perturb import build
from mapq.posed import PosedScans
from mapq.results.evaluate import Scores

TEST_SHARE, BUFFER = 0.45, 40.0
"""Of the park, from west to east: of its points that are tested on, and metres between them and the others."""
FALSE_ALARMS, ALARMS = 0.03, ", 3 %"
"""Share of plausible patches kept out that may be called suspicious, beside the best labelling; behind a name."""
Say = Callable[[str], None]


def park(data: Path, models: dict[str, Model], say: Say) -> dict[str, Any]:
    """Part 1."""
    scans = real_data.park(data)
    built = build(scans, merging=MergeSettings(submaps=True))
    parts = split_by_place(built.cloud, TEST_SHARE, BUFFER, axis=0)
    drifted = {"train": real_data.labelled(parts.train), "test": real_data.labelled(parts.test)}
    single = {name: real_data.alone(scans, parts.axis, parts.strip, name == "test") for name in drifted}
    training = [drifted["train"], *single["train"]]
    trained = {f"{name}, trained here": train_on(training, name) for name in (*METHODS, f"default{KNOWN}")}
    for name in ("default", f"default{KNOWN}"):
        model = trained[f"{name}, trained here"]
        trained[f"{name}, trained here{ALARMS}"] = with_false_alarms(model, FALSE_ALARMS, name)
    every = {SHIPPED: models[SHIPPED], SHIPPED + KNOWN: models[SHIPPED], **trained}
    say(f"left out: {'xy'[parts.axis]} from {parts.strip[0]:.0f} to {parts.strip[1]:.0f} m")
    tests = {"chained and alone": [drifted["test"], *single["test"]], "chained": [drifted["test"]]}
    found: dict[str, Any] = {}
    for name, maps in tests.items():
        scores = score(every, maps, training)
        say(f"{name}, the test part:")
        _table(scores, say)
        found[name] = as_json(scores)
    found["alone"] = {name: share_called(single["test"], name, model) for name, model in every.items()}
    say("patches of single sub-maps called suspicious (all are taken for plausible):")
    for name, row in found["alone"].items():
        say(f"  {name:42}{row['suspicious']:>6} of {row['patches']}  {row['share']:.1%}")
    found["labels"] = {name: value for name, value in built.report.items() if name != "scans"}
    return found


def published(data: Path, models: dict[str, Model], say: Say) -> dict[str, Any]:
    """Part 2, poses that are wrong beside such that are right."""
    right = real_data.kitti(data)
    cases: dict[str, tuple[PosedScans, PosedScans]] = {
        "KITTI 00, published and registered poses": (real_data.kitti(data, published=True), right)
    }
    pair = real_data.facade(data)
    cases["a pair of scans, raw and registered"] = (pair.with_poses(np.stack([np.eye(4)] * 2), "raw"), pair)
    found: dict[str, Any] = {}
    for name, (bad, good) in cases.items():
        maps = [real_data.labelled(build(scans, reference=good.poses).cloud) for scans in (bad, good)]
        say(f"{name}:")
        scores = score(models, maps, None)
        alone = score(models, maps[:1], None)
        _table(scores, say)
        say("  within the wrong map alone: " + ", ".join(f"{key} AUC {row.auc:.3f}" for key, row in alone.items()))
        ranks = {key: [_suspicious(each, key, model) for each in maps] for key, model in models.items()}
        for key, (wrong, fine) in ranks.items():
            say(f"  {key:34}patches called suspicious: {wrong:.1%} of the wrong map, {fine:.1%} of the right one")
        found[name] = {"both": as_json(scores), "wrong": as_json(alone), "shares": ranks}
    return found


def _suspicious(patches: Patches, name: str, model: Model) -> float:
    return float(share_called([patches], name, model)["share"])


def as_json(scores: dict[str, Scores]) -> dict[str, Any]:
    """Return scores as JSON has them."""
    return {name: row._asdict() for name, row in scores.items()}


def _table(scores: dict[str, Scores], say: Say) -> None:
    for line in table(scores):
        say("  " + line)


def pairs(data: Path, models: dict[str, Model], say: Say, seed: int) -> dict[str, Any]:
    """Part 3."""
    measured = real_pairs.measure(data, models, seed)
    found = real_pairs.accuracies(measured)
    for line in real_pairs.lines(measured, found):
        say(line)
    return real_pairs.as_json(measured, found)


def main() -> None:
    """Run the parts asked for and print their tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=real_data.DATA, help="folder with the public scans")
    parser.add_argument("--part", choices=("1", "2", "3"), action="append", help="one part; may be given again")
    parser.add_argument("--seed", type=int, default=1, help="of the errors of pairs")
    parser.add_argument("--json", type=Path, help="all numbers")
    options = parser.parse_args()
    parts = options.part or ["1", "2", "3"]
    say: Say = lambda line: print(line, flush=True)  # noqa: E731
    # The park trains rivals of its own.
    models = models_from_simulation() if set(parts) != {"1"} else {SHIPPED: read_default_model()}
    result: dict[str, Any] = {}
    if "1" in parts:
        result["park"] = park(options.data, models, say)
    if "2" in parts:
        result["published"] = published(options.data, models, say)
    if "3" in parts:
        result["pairs"] = pairs(options.data, models, say, options.seed)
    if options.json:
        options.json.write_text(json.dumps(result, indent=1, default=float))


if __name__ == "__main__":
    main()
