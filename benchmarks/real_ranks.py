"""Whole-map numbers against the true drift: mean map entropy, mean plane variance, and what `mapq` says.

50 maps each of a quad (five scans) and of a hall (eleven): scans with right poses, the second half displaced by up to
1 m and 2 degrees together. True drift: mean disagreement along the normal over the points of patches, in metres.
Spearman's rank correlation with it over the maps, of each number; and over the patches of all maps (suspicious above
0.3 m, plausible up to 0.1 m) the area under the curve, which numbers of whole maps have none of. The quad takes some
five minutes, the hall a quarter of an hour.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks import real_data
from benchmarks.map_metrics import map_metrics
from benchmarks.real_methods import models_from_simulation, say
from mapq.configuration import PerturbSettings
from mapq.features import measure_shapes
from mapq.labels import SUSPICIOUS, metres_of
from mapq.model import Model
from mapq.perturb import build
from mapq.perturb.build import label_points
from mapq.posed import PosedScans
from mapq.results.evaluate import score_labels
from mapq.segmentation import segment

LARGEST = (1.0, 2.0)
"""Metres and degrees; sizes grow with the square of an even draw, so that small errors are as well distinguished."""
RIGHT = 5
"""Of the maps of a set: those with no error at all."""


def measure(scans: PosedScans, models: dict[str, Model], n_maps: int) -> dict[str, Any]:
    """Return one number a map of each kind, by name, and labels and probabilities of all patches."""
    numbers: dict[str, list[float]] = {}
    patches: dict[str, list[np.ndarray]] = {}
    for seed in range(n_maps):
        size = 0.0 if seed < RIGHT else float(np.random.default_rng(seed).random() ** 2)
        error = PerturbSettings(missed_loop=(size * LARGEST[0], size * LARGEST[1]))
        found = segment(build(scans, error, reference=scans.poses, seed=seed).cloud)
        metres = np.asarray(found.cloud.fields["disagreement"], np.float64)
        inside = metres[(found.patch >= 0) & np.isfinite(metres)]
        metrics, area = map_metrics(found.cloud), measure_shapes(found).area
        row = {
            "true drift": float(inside.mean()) if len(inside) else 0.0,
            "mean map entropy": metrics.mean_map_entropy,
            "mean plane variance": metrics.mean_plane_variance,
        }
        patches.setdefault("truth", []).append(
            label_points(metres_of(found.patch, len(found), metres), PerturbSettings())
        )
        for name, model in models.items():
            said = say(found, name, model)
            row[f"{name}: suspicious area"] = float(area[said.label == SUSPICIOUS].sum() / area.sum())
            row[f"{name}: mean p"] = float(np.average(said.probability, weights=area))
            patches.setdefault(name, []).append(said.probability)
        for name, value in row.items():
            numbers.setdefault(name, []).append(value)
    return {"numbers": numbers, "patches": {name: np.concatenate(each) for name, each in patches.items()}}


def summary(measured: dict[str, Any]) -> dict[str, Any]:
    """Return rank correlations with the true drift by name, and the scores of patches by method."""
    numbers, patches = measured["numbers"], measured["patches"]
    drift, truth = numbers["true drift"], patches["truth"]
    ranks = {name: float(spearmanr(drift, each).statistic) for name, each in numbers.items() if each is not drift}
    scores = {
        name: score_labels((each > 0.5).astype(np.uint8), truth, each)._asdict()
        for name, each in patches.items()
        if name != "truth"
    }
    return {"maps": len(drift), "drift": drift, "rank_correlation": ranks, "patches": scores}


def main() -> None:
    """Run both sets and print their tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=real_data.DATA, help="folder with the public scans")
    parser.add_argument("--maps", type=int, default=50, help="of each set")
    parser.add_argument("--json", action="store_true", help="print all numbers as JSON")
    options = parser.parse_args()
    models = models_from_simulation()
    found = {}
    for name, scans in (("quad", real_data.quad(options.data)), ("hall", real_data.hall(options.data))):
        found[name] = summary(measure(scans, models, options.maps))
        if not options.json:
            tell(name, found[name])
    if options.json:
        print(json.dumps(found))


def tell(name: str, result: dict[str, Any]) -> None:
    """Print the table of a set."""
    print(f"{name}: {result['maps']} maps, true drift {min(result['drift']):.3f} to {max(result['drift']):.3f} m")
    for number, rank in result["rank_correlation"].items():
        print(f"  {number:44}{rank:>8.3f}")
    for method, row in result["patches"].items():
        print(f"  {method:34}AUC {row['auc']:.3f}  of {row['n']} patches, {row['base_rate']:.1%} suspicious")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
