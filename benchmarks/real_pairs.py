"""The protocol of CorAl and FACT: is a map of two posed scans aligned? Accuracy at two sizes of error.

Pairs of scans are mapped once as they are and twice with the second scan turned and displaced; half of the maps that
count are wrong. A method gives a map one number or two, from which a logistic regression says whether it is wrong, as
CorAl does with its two entropies. It is fitted to the maps of all *other* sets: other places, and other sensors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import real_data
from benchmarks.entropies import entropies
from benchmarks.real_methods import say
from mapq.cloud import PointCloud
from mapq.configuration import FeatureSettings
from mapq.features import patch_features
from mapq.labels import SUSPICIOUS
from mapq.model import Model
from mapq.patches import Patches
from mapq.perturb import build
from mapq.posed import PosedScans
from mapq.results.reasons import largest_median, usual_kinds
from mapq.segmentation import segment

LEVELS = ((0.01, 0.1), (0.03, 0.3))
"""Radians and metres."""
PUBLISHED = {"CorAl": (0.753, 0.956), "FACT": (0.974, 1.0)}
"""On nuScenes, as the readme of FACT has them."""
PAIRS = (("kitti", 3, 1), ("kitti", 4, 5), ("quad", 1, 1), ("quad", 1, 2), ("hall", 2, 1), ("facade", 1, 1))
"""Set; from the first scan of a pair to that of the next; and from the first scan of a pair to its second."""
ERRORS = 2
"""Of each size that every pair gets, drawn anew."""
ENTROPIES, APART, BOTH = "joint and separate entropy", "distance of scans", "{} and distance"
"""What CorAl is made of; how far apart scans put patches; and the shipped model with that."""
LEAST_METRES = 0.005
"""Below it distances of scans are alike."""
RIDGE = 0.05
"""Of the logistic regression, on standardised statistics, by map."""


class Pair(NamedTuple):
    """A map of two scans, with the statistics that each method has of it."""

    source: str
    level: int
    wrong: bool
    statistics: dict[str, list[float]]


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
    found = []
    every = sets(data)
    for name, step, gap in PAIRS:
        scans = every[name]
        for first in range(0, len(scans) - gap, step):
            two = real_data.some(scans, (first, first + gap))
            right = statistics(build(two, reference=two.poses).cloud, models)
            for level, (radians, metres) in enumerate(LEVELS):
                for _ in range(ERRORS):
                    poses = np.stack([two.poses[0], wrong_pose(two.poses[1], radians, metres, rng)])
                    wrong = statistics(build(two.with_poses(poses, name), reference=poses).cloud, models)
                    found += [Pair(name, level, False, right), Pair(name, level, True, wrong)]
    return found


def statistics(cloud: PointCloud, models: dict[str, Model]) -> dict[str, list[float]]:
    """Return the statistics of a map by method."""
    patches = segment(cloud)
    features = patch_features(patches, FeatureSettings(context=("moments",)))
    area = features.shape[:, features.shape_names.index("area_m2")]
    metres = largest_median(features.disagreement[:, 1], area, patches.kinds)
    apart = [float(np.log(max(np.nan_to_num(metres), LEAST_METRES)))]
    found = {ENTROPIES: list(entropies(cloud)), APART: apart}
    for name, model in models.items():
        found[name] = _of_map(patches, name, model, area)
        found[BOTH.format(name)] = found[name] + apart
    return found


def _of_map(patches: Patches, name: str, model: Model, area: np.ndarray) -> list[float]:
    """Return the mean probability and the suspicious share of a map, patches weighing by their area.

    Of upright or of level surfaces, whichever is larger, where these are a tenth of the area: errors along the ground
    leave floors where they are.
    """
    if len(patches) == 0:
        return [0.0, 0.0]
    said = say(patches, name, model)
    kinds = usual_kinds(area, patches.kinds)
    numbers = (said.probability, said.label == SUSPICIOUS)
    return [max(float(np.average(each[mine], weights=area[mine])) for mine in kinds) for each in numbers]


def accuracies(pairs: Sequence[Pair]) -> dict[str, list[dict[str, float]]]:
    """Return by method and level the accuracy over all maps and set by set, and the mean AUC within sets."""
    found: dict[str, list[dict[str, float]]] = {}
    for level in range(len(LEVELS)):
        some = [pair for pair in pairs if pair.level == level]
        wrong, source = np.array([pair.wrong for pair in some]), np.array([pair.source for pair in some])
        for name in some[0].statistics:
            score = foreseen(np.array([pair.statistics[name] for pair in some]), wrong, source)
            right = (score > 0.0) == wrong
            each = {str(part): float(right[source == part].mean()) for part in np.unique(source)}
            auc = [_auc(score[source == part], wrong[source == part]) for part in np.unique(source)]
            found.setdefault(name, []).append({"all": float(right.mean()), "auc": float(np.mean(auc)), **each})
    return found


def foreseen(values: np.ndarray, wrong: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Return log-odds (n,) of being wrong from statistics (n, k), by a regression on the maps of the other sets."""
    found = np.zeros(len(values))
    for name in np.unique(source):
        others = source != name
        middle, scale = values[others].mean(axis=0), np.maximum(values[others].std(axis=0), 1e-6)
        columns = np.column_stack([np.ones(len(values)), (values - middle) / scale])
        found[~others] = columns[~others] @ _logistic(columns[others], wrong[others].astype(float))
    return found


def _logistic(columns: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the weights (k,) of a logistic regression with a ridge, by Newton's steps."""
    weights = np.zeros(columns.shape[1])
    ridge = RIDGE * np.append(0.0, np.ones(columns.shape[1] - 1))
    for _ in range(30):
        p = 1.0 / (1.0 + np.exp(-columns @ weights))
        slope = columns.T @ (truth - p) - ridge * weights
        curve = (columns * (p * (1.0 - p))[:, None]).T @ columns + np.diag(ridge) + 1e-9 * np.eye(len(weights))
        step = np.linalg.solve(curve, slope)
        weights = weights + step / max(1.0, float(np.abs(step).max()))
    return np.asarray(weights)


def _auc(score: np.ndarray, wrong: np.ndarray) -> float:
    """Return the chance that a wrong map has the higher score of two, ties half."""
    apart = score[wrong][:, None] - score[~wrong]
    return float(np.mean((apart > 0.0) + 0.5 * (apart == 0.0)))


def as_json(pairs: Sequence[Pair], found: dict[str, Any]) -> dict[str, Any]:
    """Return what was measured and what came of it."""
    return {"accuracies": found, "maps": [pair._asdict() for pair in pairs]}


def lines(pairs: Sequence[Pair], found: dict[str, list[dict[str, float]]]) -> Iterator[str]:
    """Yield the table of accuracies."""
    counts = {name: sum(pair.source == name for pair in pairs) // (4 * ERRORS) for name in sorted(sets_of(pairs))}
    yield "pairs: " + ", ".join(f"{count} {name}" for name, count in counts.items()) + f"; {len(pairs)} maps"
    columns = [f"{radians} rad, {metres} m" for radians, metres in LEVELS]
    yield f"{'accuracy, and mean AUC within sets':44}" + "".join(f"{column:>24}" for column in columns)
    for name, row in {
        **{f"{key} (published, on nuScenes)": value for key, value in PUBLISHED.items()},
        "majority": (0.5, 0.5),
    }.items():
        yield f"{name:44}" + "".join(f"{value:>16.3f}{'':8}" for value in row)
    for name, levels in found.items():
        yield f"{name:44}" + "".join(f"{each['all']:>16.3f}{each['auc']:>8.3f}" for each in levels)
        parts = ("; ".join(f"{key} {each[key]:.2f}" for key in counts) for each in levels)
        yield " " * 4 + "   |   ".join(parts)


def sets_of(pairs: Sequence[Pair]) -> set[str]:
    """Return the names of the sets that maps are of."""
    return {pair.source for pair in pairs}
