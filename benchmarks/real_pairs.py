"""The protocol of CorAl and FACT: is a map of two posed scans aligned? Accuracy at two sizes of error.

Every pair of neighbouring scans is mapped once as it is and once with its second scan turned and displaced, so half of
the maps are wrong. A method gives a map one number; the threshold is that which separates best the maps of all *other*
sets. Entropy, joint minus separate, is the idea of CorAl on `mapq`'s own mean map entropy: not its code, and without
its per-point test of overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import real_data
from benchmarks.real_methods import say
from mapq.cloud import PointCloud
from mapq.features import FeatureSettings, patch_features
from mapq.metrics import map_metrics
from mapq.model import Model
from mapq.patches import SUSPICIOUS, Patches
from mapq.perturb import build
from mapq.posed import PosedScans
from mapq.segment import segment

LEVELS = ((0.01, 0.1), (0.03, 0.3))
"""Radians and metres."""
PUBLISHED = {"CorAl": (0.753, 0.956), "FACT": (0.974, 1.0)}
"""On nuScenes, as the readme of FACT has them."""
STEPS = {"kitti": 2, "hall": 2}
"""Of the first scan of a pair from one pair to the next, where it is not one."""
ALARM = 0.05
"""Share of suspicious area from which on a map is called wrong without any training."""
FOR_ENTROPY = 60_000
"""Points of a map that entropy is taken of, at most."""
ENTROPY = "entropy, joint minus separate"


class Pair(NamedTuple):
    """A map of two scans."""

    source: str
    level: int
    wrong: bool
    scores: dict[str, float]


def sets(data: Path) -> dict[str, PosedScans]:
    """Return the sets with poses that are right."""
    return {
        "kitti": real_data.kitti(data),
        "quad": real_data.quad(data),
        "hall": real_data.hall(data),
        "facade": real_data.facade(data),
    }


def wrong_pose(pose: np.ndarray, radians: float, metres: float, rng: np.random.Generator) -> np.ndarray:
    """Return a pose (4, 4) turned about the vertical at its place, and displaced in a level direction."""
    angle, direction = radians * rng.choice([-1.0, 1.0]), rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    moved = pose.copy()
    moved[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ pose[:3, :3]
    moved[:2, 3] += metres * np.array([np.cos(direction), np.sin(direction)])
    return moved


def measure(data: Path, models: dict[str, Model], seed: int) -> list[Pair]:
    """Return all maps of pairs with what each method makes of them."""
    rng = np.random.default_rng(seed)
    pairs = []
    for name, scans in sets(data).items():
        for first in range(0, len(scans) - 1, STEPS.get(name, 1)):
            two = real_data.some(scans, (first, first + 1))
            mapped = build(two, reference=two.poses).cloud
            separate = _entropy_apart(mapped)
            right = _scores(mapped, models, separate)
            for level, (radians, metres) in enumerate(LEVELS):
                poses = np.stack([two.poses[0], wrong_pose(two.poses[1], radians, metres, rng)])
                wrong = _scores(build(two.with_poses(poses, name), reference=poses).cloud, models, separate)
                pairs += [Pair(name, level, False, right), Pair(name, level, True, wrong)]
    return pairs


def _entropy_apart(cloud: PointCloud) -> float:
    """Return the mean map entropy of the scans of a map by themselves, points weighing alike."""
    thin = _thinned(cloud)
    parts = [thin.take(thin.fields["scan"] == number) for number in (0, 1)]
    values = [map_metrics(part).mean_map_entropy for part in parts]
    return float(np.average(values, weights=[len(part) for part in parts]))


def _thinned(cloud: PointCloud) -> PointCloud:
    """Return every so manieth point: entropy of dense neighbourhoods takes minutes a map and says no more."""
    return cloud.take(np.arange(0, len(cloud), -(-len(cloud) // FOR_ENTROPY)))


def _scores(cloud: PointCloud, models: dict[str, Model], separate: float) -> dict[str, float]:
    patches = segment(cloud)
    features = patch_features(patches, FeatureSettings(context=()))
    area = features.shape[:, features.shape_names.index("area_m2")]
    found = {ENTROPY: map_metrics(_thinned(cloud)).mean_map_entropy - separate}
    for name, model in models.items():
        found[name], found[f"{name}, alarm"] = _of_map(patches, name, model, area)
    return found


def _of_map(patches: Patches, name: str, model: Model, area: np.ndarray) -> tuple[float, float]:
    """Return the mean probability and the suspicious share of a map, patches weighing by their area."""
    if len(patches) == 0:
        return 0.0, 0.0
    said = say(patches, name, model)
    return float(np.average(said.probability, weights=area)), float(np.average(said.label == SUSPICIOUS, weights=area))


def accuracies(pairs: list[Pair], methods: list[str]) -> dict[str, Any]:
    """Return the accuracy of methods at each level, over all sets and set by set."""
    found: dict[str, Any] = {}
    for level in range(len(LEVELS)):
        some = [pair for pair in pairs if pair.level == level]
        wrong, source = np.array([pair.wrong for pair in some]), np.array([pair.source for pair in some])
        for name in (ENTROPY, *methods):
            said = _thresholded(np.array([pair.scores[name] for pair in some]), wrong, source)
            found.setdefault(name, []).append(_rates(said == wrong, source))
        for name in methods:
            said = np.array([pair.scores[f"{name}, alarm"] for pair in some]) > ALARM
            found.setdefault(f"{name}, without threshold", []).append(_rates(said == wrong, source))
    return found


def _thresholded(score: np.ndarray, wrong: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Return which maps (n,) are called wrong, by the threshold that is best for the other sets."""
    said = np.zeros(len(score), bool)
    for name in np.unique(source):
        others = source != name
        values = np.sort(np.unique(score[others]))
        cuts = np.concatenate([[-np.inf], 0.5 * (values[1:] + values[:-1]), [np.inf]])
        right = [np.mean((score[others] > cut) == wrong[others]) for cut in cuts]
        said[~others] = score[~others] > cuts[int(np.argmax(right))]
    return said


def _rates(right: np.ndarray, source: np.ndarray) -> dict[str, float]:
    return {
        "all": float(right.mean()),
        **{str(name): float(right[source == name].mean()) for name in np.unique(source)},
    }


def lines(pairs: list[Pair], found: dict[str, Any]) -> Iterator[str]:
    """Yield the table of accuracies."""
    counts = {name: sum(pair.source == name for pair in pairs) // 4 for name in dict.fromkeys(p.source for p in pairs)}
    yield "pairs: " + ", ".join(f"{count} {name}" for name, count in counts.items())
    columns = [f"{radians} rad, {metres} m" for radians, metres in LEVELS]
    yield f"{'':44}" + "".join(f"{column:>20}" for column in columns)
    for name, row in {
        **{f"{key} (nuScenes)": value for key, value in PUBLISHED.items()},
        "majority": (0.5, 0.5),
    }.items():
        yield f"{name:44}" + "".join(f"{value:>20.3f}" for value in row)
    for name, levels in found.items():
        yield f"{name:44}" + "".join(f"{each['all']:>20.3f}" for each in levels)
        parts = ("; ".join(f"{key} {value:.2f}" for key, value in each.items() if key != "all") for each in levels)
        yield " " * 4 + "   |   ".join(parts)
