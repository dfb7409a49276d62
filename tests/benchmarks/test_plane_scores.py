from __future__ import annotations

import numpy as np
import pytest

from benchmarks.plane_scores import score_segmentation, truth_of
from mapq.cloud import PointCloud
from prf.shell.errors import InputError


def repeat(*runs: tuple[int, int]) -> np.ndarray:
    return np.concatenate([np.full(n, value, np.int32) for value, n in runs])


def test_a_perfect_segmentation() -> None:
    truth = repeat((4, 50), (-1, 10), (9, 30))
    score = score_segmentation(repeat((1, 50), (-1, 10), (0, 30)), truth)
    assert (score.n_planes, score.n_patches, score.n_matched) == (2, 2, 2)
    assert (score.precision, score.recall, score.mean_iou, score.mean_dice) == (1, 1, 1, 1)
    assert (score.over_segmented, score.under_segmented, score.missed, score.noise) == (0, 0, 0, 0)
    assert score.plane.tolist() == [4, 9]
    assert score.best_patch.tolist() == [1, 0]


def test_a_plane_in_two_pieces_is_over_segmented() -> None:
    score = score_segmentation(repeat((0, 60), (1, 40)), repeat((0, 100)))
    assert (score.over_segmented, score.n_matched, score.missed, score.noise) == (1, 0, 0, 0)
    assert score.iou.tolist() == [0.6]
    assert score.mean_dice == pytest.approx(2 * 60 / 160)


def test_two_planes_in_one_patch_are_under_segmented() -> None:
    score = score_segmentation(repeat((0, 100)), repeat((0, 50), (1, 50)))
    assert (score.under_segmented, score.over_segmented, score.n_matched, score.missed) == (1, 0, 0, 0)


def test_missed_planes_and_noise() -> None:
    score = score_segmentation(repeat((-1, 80), (0, 20), (1, 30)), repeat((0, 100), (-1, 30)))
    assert (score.missed, score.noise) == (1, 1)
    assert (score.precision, score.recall) == (0, 0)
    assert score_segmentation(repeat((-1, 9)), repeat((0, 9))).best_patch.tolist() == [-1]


def test_the_threshold_is_strict() -> None:
    patch, truth = repeat((0, 75), (-1, 25)), repeat((0, 100))
    assert score_segmentation(patch, truth).n_matched == 0
    assert score_segmentation(patch, truth, 0.5).n_matched == 1


def test_no_patches_have_no_precision() -> None:
    assert np.isnan(score_segmentation(repeat((-1, 5)), repeat((0, 5))).precision)


def test_bad_truth_is_refused() -> None:
    with pytest.raises(InputError, match="every number is negative"):
        score_segmentation(repeat((0, 5)), repeat((-1, 5)))
    with pytest.raises(InputError, match="one of each a point"):
        score_segmentation(repeat((0, 5)), repeat((0, 4)))
    fields = {"plane": np.array([0.0, 1.5]), "pair": np.zeros((2, 2))}
    cloud = PointCloud(np.zeros((2, 3)), np.zeros(3), fields, source="x.ply")
    with pytest.raises(InputError, match="no field 'walls'; it has: plane, pair"):
        truth_of(cloud, "walls")
    with pytest.raises(InputError, match="no whole numbers"):
        truth_of(cloud, "plane")
    with pytest.raises(InputError, match="not one number a point"):
        truth_of(cloud, "pair")
    assert truth_of(cloud.with_fields(plane=np.array([2.0, -1.0])), "plane").tolist() == [2, -1]
