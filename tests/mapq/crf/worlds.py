"""Maps of patches drawn from a known rule: regions of suspicious patches, pairs inside them often of low x_ij."""

from __future__ import annotations

import numpy as np

from mapq.crf.cross_validation import split_regions
from mapq.crf.train import TrainingMap
from mapq.features.table import PatchFeatures
from mapq.labels import UNLABELLED


def draw_map(seed: int, n_patches: int = 300, node_signal: float = 1.0, share_unlabelled: float = 0.0) -> TrainingMap:
    """Return a map in the plane, about a third of it suspicious in contiguous regions, neighbours by distance."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 100.0, (n_patches, 2))
    centres = rng.uniform(0.0, 100.0, (4, 2))
    suspicious = np.linalg.norm(xy[:, None] - centres, axis=2).min(axis=1) < 18.0
    distance = np.linalg.norm(xy[:, None] - xy, axis=2)
    nearest = np.argsort(distance, axis=1)[:, 1:5]
    pairs = np.unique(np.sort(np.column_stack([np.repeat(np.arange(n_patches), 4), nearest.ravel()]), axis=1), axis=0)
    inside = suspicious[pairs].all(axis=1)
    bad = rng.random(len(pairs)) < np.where(inside, 0.6, 0.03)
    x = np.where(bad, rng.uniform(-1.0, 0.2, len(pairs)), rng.uniform(0.8, 1.0, len(pairs)))
    node = rng.normal(size=(n_patches, 2)) + node_signal * np.column_stack([suspicious, np.zeros(n_patches)])
    features = PatchFeatures(node, pairs.astype(np.int32), x[:, None] ** 2, x, ("fit", "tilt"), ("w",))
    label = np.where(rng.random(n_patches) < share_unlabelled, UNLABELLED, suspicious).astype(np.uint8)
    centroid = np.column_stack([xy, np.zeros(n_patches)])
    return TrainingMap(features, label, split_regions(centroid, 40))
