"""What `benchmarks.unseen` sets beside `mapq`: plain numbers of a patch, and a forest on the measured features."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree
from sklearn.ensemble import RandomForestClassifier

from benchmarks.commands import ROOT
from benchmarks.entropies import LEAST, entropy_of, moments_of
from benchmarks.map_metrics import map_metrics
from benchmarks.real_methods import without_scans
from data import make_default_model as recipe
from mapq.configuration import FeatureSettings
from mapq.features import patch_features
from mapq.features.table import PatchFeatures
from mapq.io import read_patches, write_patches
from mapq.labels import SUSPICIOUS, UNLABELLED
from mapq.patches import Patches
from mapq.posed.merge import cell_keys

RADIUS, THIN, ASKED = 0.5, 0.1, 60
"""Metres round a point whose entropy is taken and between points; and points of a patch that are asked."""
BESIDE, CELL, FEWEST = 1.0, 0.5, 5
"""Metres off the plane up to which scans are compared; side of an outline's cells; and points that a scan needs."""
MOST_POINTS = 400_000
"""Of a map in which scans are compared."""
TREES, LEAF = 300, 5
"""Of the forest: its trees, and the fewest patches in a leaf."""
SOURCES = ("mapq/features", "mapq/kernels")
"""What the forest depends on beside its maps."""


class Plain(NamedTuple):
    """Numbers of a map that no model has a part in.

    Attributes
    ----------
    metres : (m,) float64
        True disagreement; nan where it is not known.
    spread : (m,) float64 or None
        From the lowest to the highest of the medians of scans along the normal; nan where fewer than two saw a patch.
        None where nobody may know of scans.
    entropy : (m,) float64
        Mean over the patch; nan where its surroundings are too sparse.
    whole : float
        Mean map entropy.
    """

    metres: np.ndarray
    spread: np.ndarray | None
    entropy: np.ndarray
    whole: float


def plain_numbers(patches: Patches, kept: Path) -> Plain:
    """Return the numbers of a map, from file `kept` where it is there."""
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        unknown = np.full(len(patches), np.nan)
        metres = unknown if patches.apart is None else patches.apart
        spread = spread_of(patches) if "scan" in patches.cloud.fields else unknown
        thinned = patches.cloud.take(_one_a_cell(patches))
        entropy, whole = entropy_by_patch(patches, thinned.xyz), map_metrics(thinned).mean_map_entropy
        np.savez(kept, metres=metres, spread=spread, entropy=entropy, whole=whole)
    with np.load(kept) as found:
        return Plain(found["metres"], found["spread"], found["entropy"], float(found["whole"]))


def _one_a_cell(patches: Patches) -> np.ndarray:
    """Return the first point (k,) of each cell: entropies of maps of different density are not alike otherwise."""
    rows = np.flatnonzero(patches.cloud.finite())
    return rows[np.sort(np.unique(cell_keys(patches.cloud.xyz[rows], THIN), return_index=True)[1])]


def entropy_by_patch(patches: Patches, thinned: np.ndarray) -> np.ndarray:
    """Return the mean entropy (m,) of the surroundings of points of each patch, among the points `thinned` (k, 3)."""
    tree = KDTree(thinned)
    points, start = patches.members
    found = np.full(len(patches), np.nan)
    for patch in range(len(patches)):
        own = points[start[patch] : start[patch + 1]]
        sums = moments_of(tree, patches.cloud.xyz[own[:: -(-len(own) // ASKED)]], np.array(RADIUS))
        enough = sums[:, 0] >= LEAST
        if enough.any():
            found[patch] = entropy_of(sums[enough]).mean()
    return found


def spread_of(patches: Patches) -> np.ndarray:
    """Return how far apart (m,) the medians of scans lie over each patch, of all points near its plane and outline."""
    rng = np.random.default_rng(0)
    rows = np.flatnonzero(patches.cloud.finite())
    rows = rows if len(rows) <= MOST_POINTS else rng.choice(rows, MOST_POINTS, replace=False)
    xyz, scan = patches.cloud.xyz[rows], np.asarray(patches.cloud.fields["scan"])[rows]
    tree = KDTree(xyz)
    points, start = patches.members
    found = np.full(len(patches), np.nan)
    for patch in range(len(patches)):
        own = patches.cloud.xyz[points[start[patch] : start[patch + 1]]] - patches.centroid[patch]
        widest = float(np.linalg.norm(own, axis=1).max()) + BESIDE
        near = np.asarray(tree.query_ball_point(patches.centroid[patch], widest), np.int64)
        found[patch] = _range_of_medians(own, xyz[near] - patches.centroid[patch], scan[near], patches.normal[patch])
    return found


def _range_of_medians(own: np.ndarray, near: np.ndarray, scan: np.ndarray, normal: np.ndarray) -> float:
    """Return from the lowest to the highest median height of scans, of points (n, 3) over a patch of points (k, 3)."""
    height = near @ normal
    inside = np.isin(_cells(near, normal), _cells(own, normal)) & (np.abs(height) <= BESIDE)
    medians = [
        np.median(height[inside & (scan == each)])
        for each in np.unique(scan[inside])
        if np.count_nonzero(inside & (scan == each)) >= FEWEST
    ]
    return float(np.ptp(medians)) if len(medians) > 1 else float("nan")


def _cells(apart: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return a number (n,) for the cell of a plane in which each place (n, 3) lies."""
    x, y = np.floor(apart @ np.linalg.svd(normal[None])[2][1:].T / CELL).astype(np.int64).T
    return np.asarray((x << 20) + y)


def columns_of(features: PatchFeatures) -> np.ndarray:
    """Return what is measured on each patch (m, k): its features, and the extremes and means of those of its pairs."""
    m = len(features.node)
    one, other = features.pairs.T
    ends, values = (
        np.concatenate([one, other]),
        np.tile(np.column_stack([features.edge, features.plausibility]), (2, 1)),
    )
    count = np.bincount(ends, minlength=m)
    high, low = (np.full((m, values.shape[1]), fill) for fill in (-np.inf, np.inf))
    np.maximum.at(high, ends, values)
    np.minimum.at(low, ends, values)
    mean = np.stack([np.bincount(ends, column, m) for column in values.T], axis=1) / np.maximum(count, 1)[:, None]
    none = count == 0
    high[none], low[none] = 0.0, 0.0
    return np.column_stack([features.node, high, low, mean, count])


def forest_of(folder: Path, settings: FeatureSettings, say: Callable[[str], None]) -> RandomForestClassifier | None:
    """Return a plain forest on the features of the maps that the shipped model was trained on; None without these.

    It is kept in `folder` for as long as the code that measures stays as it is.
    """
    files = sorted(folder.glob("*.patches"))
    if not files:
        return None
    kept = folder / f"forest-{_digest(files, settings)}.pickle"
    if kept.exists():
        return pickle.loads(kept.read_bytes())
    columns, labels = [], []
    for path in files:
        patches = read_patches(path)
        columns.append(columns_of(patch_features(patches, settings)))
        labels.append(patches.label)
        say(f"measured {path.name}")
    label = np.concatenate(labels)
    known = label != UNLABELLED
    forest = RandomForestClassifier(TREES, min_samples_leaf=LEAF, random_state=0)
    forest.fit(np.concatenate(columns)[known], label[known] == SUSPICIOUS)
    kept.write_bytes(pickle.dumps(forest))
    return forest


def _digest(files: list[Path], settings: FeatureSettings) -> str:
    code = [path.read_bytes() for folder in SOURCES for path in sorted((ROOT / folder).glob("*.py"))]
    return hashlib.sha256(repr((files, settings.stored())).encode() + b"".join(code)).hexdigest()[:12]


def make_training_maps(folder: Path, say: Callable[[str], None]) -> None:
    """Write the maps that the shipped model is trained on, as its recipe makes them."""
    folder.mkdir(parents=True, exist_ok=True)
    makers = [(f"world-{seed}", partial(recipe.world, seed)) for seed in range(recipe.N_WORLDS)]
    makers += [(f"city-{row[0]}", partial(recipe.city, row)) for row in recipe.CITIES]
    for name, make in makers:
        patches = make()
        for path, each in ((f"{name}.patches", patches), (f"{name}-bare.patches", without_scans(patches))):
            write_patches(str(folder / path), each)
        say(f"made {name}")
