"""A scene of a thousand points with most of what a segmentation has to decide; plain Python does it in seconds."""

from __future__ import annotations

import numpy as np

from benchmarks.plane_scores import score_segmentation
from mapq.segmentation import SegmentSettings, segment
from tests.reference.mapq_segment import cloud_of, ground, wall


def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_crossing_copies_a_corner_the_ground_and_outliers() -> None:
    copies = wall(rng(1), 4.0, 2.5, 0.2), wall(rng(2), 4.0, 2.5, 0.2, degrees=8.0)
    corner = wall(rng(3), 3.0, 2.5, 0.2, degrees=90.0, start=3.5)
    strays = rng(4).uniform(-3.0, 3.0, (40, 3))
    cloud, truth = cloud_of(*copies, corner, ground(rng(5), 5.0, 0.25), strays)
    patches = segment(cloud, SegmentSettings(max_tilt=90.0))
    score = score_segmentation(patches.patch, truth)
    assert len(patches) == 4
    assert len({*score.best_patch[:4].tolist()}) == 4
    assert score.iou[:2].min() > 0.75, "copies that cross"
    assert score.iou[2:4].min() > 0.95, "corner and ground"
    assert np.mean(patches.patch[truth == 4] == -1) > 0.6, "strays"
