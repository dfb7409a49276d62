"""From labelled patches to a model."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import FeatureSettings, TrainSettings
from mapq.crf.cross_validation import Trained, split_regions, train
from mapq.crf.train import TrainingMap
from mapq.features import patch_features
from mapq.io import read_patches
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.model import Model
from mapq.patches import Patches
from mapq.results.evaluate import Scores, score_labels
from prf.shell.cli.console import Report
from prf.shell.cli.storage import describe_input, describe_process
from prf.shell.errors import require

N_REGIONS = 20
"""About the number of regions into which labelled patches are cut for cross-validation."""
TOLERANCES = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)
"""Metres at which a model learns what is wrong, where labels are metres."""
CLOSE = 1.0 / 3.0
"""Share of the tolerance from which points alone do not tell whether a surface is apart by more than it."""
SMALLEST_REGION = 8
"""Patches: smaller regions would part neighbours wherever they are cut."""


def train_maps(
    sources: Sequence[Patches | str | os.PathLike[str]],
    settings: TrainSettings | None = None,
    features: FeatureSettings | None = None,
    progress: Report | None = None,
    conservative: bool = False,
) -> Model:
    """Return the model that labelled patches teach.

    `sources`: maps, or PATCHES files of them. `features`: stored in the model: it measures other maps in the same way.
    `progress`: receives the number of maps read and measured. `conservative`: of a map that has labels, count patches
    without one as suspicious: they are not surely plausible. Raises InputError unless
    every file is a PATCHES file, and there are labels of both kinds.
    """
    settings, features = settings or TrainSettings(), features or FeatureSettings()
    if settings.potential == "trees":
        require("sklearn", "train", "training of trees")
    if settings.objective == "max-margin":
        require("clarabel", "train", "objective max-margin")
    maps = []
    for number, source in enumerate(sources):
        maps.append(source if isinstance(source, Patches) else read_patches(source))
        if progress is not None:
            progress(number + 0.5)
    if conservative:
        maps = [replace(patches, label=conservative_label(patches)) for patches in maps]
    labels, tolerances = [patches.label for patches in maps], tolerances_of(maps)
    training_maps = []
    regions = regions_of(maps, labels, region_size(labels, N_REGIONS))
    for number, (patches, region) in enumerate(zip(maps, regions, strict=True)):
        measured = patch_features(patches, features)
        training_maps += [
            TrainingMap(measured, patches.label_at(t), region, t, _between(patches, t)) for t in tolerances
        ]
        if progress is not None:
            progress(number + 1)
    trained = train(training_maps, settings)
    scores = None
    if trained.held_out is not None:
        scores = score_labels(trained.held_out.label, trained.held_out.truth, trained.held_out.probability)
    kind = "conservative" if conservative else "given"
    summary = {**summarise(sources, maps, labels, trained, settings, scores), "labels": kind}
    return replace(trained.model, features=features.stored(), training=summary)


def _between(patches: Patches, tolerance: float) -> NDArray[np.bool_] | None:
    """Return which patches (m,) are apart by a third of the tolerance or more, and not by more than it."""
    apart = patches.apart
    return None if apart is None else np.asarray((apart > CLOSE * tolerance) & (apart <= tolerance))


def tolerances_of(maps: Sequence[Patches]) -> list[float]:
    """Return the tolerances in metres, ascending, at which there are labels of both kinds; else those of the labels.

    Where it is known by how many metres patches are apart, `TOLERANCES` too.
    """
    own = {patches.label_tolerance for patches in maps}
    tried = own.union(*(TOLERANCES for patches in maps if patches.apart is not None))
    labels = {each: np.concatenate([patches.label_at(each) for patches in maps]) for each in sorted(tried)}
    both = [each for each, label in labels.items() if {PLAUSIBLE, SUSPICIOUS} <= set(label.tolist())]
    return both or sorted(own)


def region_size(labels: Sequence[NDArray[np.uint8]], n_regions: int) -> int:
    """Return the number of labelled patches a region may have, for about `n_regions` regions over all maps."""
    n_labelled = sum(int(np.count_nonzero(label != UNLABELLED)) for label in labels)
    return max(SMALLEST_REGION, -(-n_labelled // n_regions))


def regions_of(
    maps: Sequence[Patches], labels: Sequence[NDArray[np.uint8]], max_patches: int
) -> list[NDArray[np.int64]]:
    """Return the region (m,) of the labelled patches of each map, numbered over all; without a label region 0."""
    regions, n_regions = [], 0
    for patches, label in zip(maps, labels, strict=True):
        region = np.zeros(len(patches), np.int64)
        known = label != UNLABELLED
        if known.any():
            region[known] = split_regions(patches.centroid[known], max_patches) + n_regions
            n_regions = int(region.max()) + 1
        regions.append(region)
    return regions


def conservative_label(patches: Patches) -> NDArray[np.uint8]:
    """Return the labels (m,) of a map, patches without one suspicious; of a map without any label, as they are."""
    unknown = patches.label == UNLABELLED
    return patches.label if unknown.all() else np.where(unknown, np.uint8(SUSPICIOUS), patches.label)


def summarise(
    sources: Sequence[Patches | str | os.PathLike[str]],
    maps: Sequence[Patches],
    labels: Sequence[NDArray[np.uint8]],
    trained: Trained,
    settings: TrainSettings,
    scores: Scores | None,
) -> dict[str, Any]:
    """Return what the model file records of its training."""
    process = describe_process()
    inputs = [_input(number, source) for number, source in enumerate(sources)]
    held_out = {
        "n_folds": trained.n_folds,
        "tried": [
            {"regularisation": strength.weights, "coupling_regularisation": strength.coupling, "log_loss": loss}
            for strength, loss in trained.scores.items()
        ],
        **(scores._asdict() if scores is not None else {}),
        "calibrations": trained.held_out.calibrations if trained.held_out is not None else {},
    }
    return {
        "versions": process["versions"],
        "created": process["created"],
        "objective": settings.objective,
        "potential": settings.potential,
        "regularisation": trained.strength.weights,
        "coupling_regularisation": trained.strength.coupling,
        "class_weight": settings.class_weight,
        "n_patches": sum(int(np.count_nonzero(label != UNLABELLED)) for label in labels),
        "n_suspicious": sum(int(np.count_nonzero(label == SUSPICIOUS)) for label in labels),
        "pseudo_log_likelihood": trained.pseudo_log_likelihood,
        "importance": trained.importance,
        "held_out": held_out,
        "maps": [_map_row(*each) for each in zip(inputs, maps, labels, strict=True)],
    }


def _input(number: int, source: Patches | str | os.PathLike[str]) -> dict[str, Any]:
    """Return the name of a map and the digest of its file, which patches in memory do not have."""
    if isinstance(source, Patches):
        return {"path": source.cloud.source or f"map {number}", "sha256": None}
    return describe_input(source)


def _map_row(given: dict[str, Any], patches: Patches, label: NDArray[np.uint8]) -> dict[str, Any]:
    """Return what is kept of a map: its name and digest, counts, and how it was segmented."""
    return {
        "name": PurePath(given["path"]).name,
        "sha256": given["sha256"],
        "n_patches": len(patches),
        "n_plausible": int(np.count_nonzero(label == PLAUSIBLE)),
        "n_suspicious": int(np.count_nonzero(label == SUSPICIOUS)),
        "segmentation": dict(patches.parameters),
    }
