from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.select import assign_folds, split_regions


def test_regions_are_small_enough_alike_and_whole_boxes():
    rng = np.random.default_rng(0)
    centroid = rng.uniform(0, [200.0, 50.0, 10.0], (500, 3))
    region = split_regions(centroid, 40)
    sizes = np.bincount(region)
    assert sizes.max() <= 40
    assert sizes.min() >= sizes.max() // 2
    boxes = [(centroid[region == r, :2].min(axis=0), centroid[region == r, :2].max(axis=0)) for r in range(len(sizes))]
    for index, (low, high) in enumerate(boxes):
        inside = ((centroid[:, :2] > low) & (centroid[:, :2] < high)).all(axis=1)
        assert (region[inside] == index).all()


@pytest.mark.parametrize("n_patches", [0, 1, 3])
def test_few_patches_are_one_region(n_patches):
    assert split_regions(np.zeros((n_patches, 3)), 5).tolist() == [0] * n_patches


def test_patches_at_one_place_are_split_too():
    assert np.bincount(split_regions(np.zeros((10, 3)), 3)).max() <= 3


def test_folds_keep_regions_whole_and_share_suspicious_patches():
    rng = np.random.default_rng(1)
    region = np.repeat(np.arange(20), 15)
    suspicious = rng.random(300) < np.repeat(rng.random(20), 15)
    fold = assign_folds(region, suspicious, 5)
    assert set(fold) == set(range(5))
    assert all(len(np.unique(fold[region == r])) == 1 for r in range(20))
    counts = np.bincount(fold[suspicious])
    assert counts.max() - counts.min() <= 15


def test_no_more_folds_than_regions():
    assert set(assign_folds(np.array([0, 0, 1]), np.array([True, False, True]), 5)) == {0, 1}
    assert len(assign_folds(np.empty(0, int), np.empty(0, bool), 5)) == 0


def test_regions_of_one_label_are_dealt_over_folds_too():
    region = np.repeat(np.arange(8), 8)
    suspicious = region % 2 == 0
    fold = assign_folds(region, suspicious, 4)
    for index in range(4):
        assert suspicious[fold == index].mean() == 0.5
