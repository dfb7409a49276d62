from __future__ import annotations

import math

import numpy as np
import pytest

from mapq.labels import UNLABELLED
from mapq.results.evaluate import area_under_curve, calibration_error, reliability, score_labels


def of_counts(pp: int, ps: int, sp: int, ss: int):
    label = np.repeat([0, 0, 1, 1], [pp, ps, sp, ss]).astype(np.uint8)
    truth = np.repeat([0, 1, 0, 1], [pp, ps, sp, ss]).astype(np.uint8)
    return score_labels(label, truth, np.where(label, 0.75, 0.25))


def test_table_2_of_the_paper():
    """Its percentages have one solution in whole numbers; accuracy 80.42 % as printed, rows inferred."""
    scores = of_counts(648, 40, 219, 416)
    assert scores.n == 1323
    assert scores.confusion == ((648, 40), (219, 416))
    assert math.floor(scores.accuracy * 1e4) == 8042
    assert math.floor(scores.precision * 1e4) == 6551
    assert scores.recall == pytest.approx(0.912, abs=5e-4)
    assert scores.specificity == pytest.approx(0.747, abs=5e-4)
    assert scores.balanced_accuracy == pytest.approx(0.830, abs=5e-4)
    assert scores.f1 == pytest.approx(0.763, abs=5e-4)
    assert scores.mcc == pytest.approx(0.628, abs=5e-4)
    assert scores.base_rate == pytest.approx(456 / 1323)


def test_scores_by_their_definitions():
    rng = np.random.default_rng(0)
    truth, label = rng.integers(0, 2, 60).astype(np.uint8), rng.integers(0, 2, 60).astype(np.uint8)
    p = np.round(rng.random(60), 1)
    scores = score_labels(label, truth, p)
    wins = [(a > b) + 0.5 * (a == b) for a in p[truth == 1] for b in p[truth == 0]]
    assert scores.auc == pytest.approx(np.mean(wins))
    assert scores.brier == pytest.approx(np.mean((p - truth) ** 2))
    assert scores.mcc == pytest.approx(np.corrcoef(label, truth)[0, 1])
    precision, recall = truth[label == 1].mean(), label[truth == 1].mean()
    assert scores.f1 == pytest.approx(2 / (1 / precision + 1 / recall))
    cut = np.clip(p, 1e-6, 1 - 1e-6)
    assert scores.log_loss == pytest.approx(-np.mean(np.log(np.where(truth == 1, cut, 1 - cut))))


def test_calibration_error_by_its_definition():
    p = np.array([0.05, 0.05, 0.95, 1.0])
    assert calibration_error(p, np.array([False, True, True, True])) == pytest.approx((2 * 0.45 + 2 * 0.025) / 4)
    rng = np.random.default_rng(1)
    many = rng.random(100_000)
    assert calibration_error(many, rng.random(100_000) < many) < 0.01
    assert calibration_error(many, rng.random(100_000) < many**3) > 0.1


def test_patches_without_truth_are_left_out():
    label = np.array([0, 1, 1, UNLABELLED], np.uint8)
    scores = score_labels(label, np.array([0, 1, UNLABELLED, 1], np.uint8), np.array([0.1, 0.9, 0.9, np.nan]))
    assert (scores.n, scores.n_without_truth, scores.accuracy, scores.auc) == (2, 1, 1.0, 1.0)


def test_ratios_of_nothing_are_not_numbers():
    scores = of_counts(3, 0, 0, 0)
    assert (scores.accuracy, scores.specificity) == (1.0, 1.0)
    for name in ("precision", "recall", "f1", "mcc", "auc", "balanced_accuracy"):
        assert math.isnan(getattr(scores, name)), name
    assert score_labels(*[np.empty(0, np.uint8)] * 2, np.empty(0)).n == 0
    assert math.isnan(area_under_curve(np.ones(3), np.ones(3, bool)))


def test_reliability_by_its_definition():
    p, truth = np.array([0.05, 0.15, 0.12, 0.95, 1.0, np.nan, 0.5]), np.array([0, 1, 0, 1, 1, 1, UNLABELLED], np.uint8)
    bins = reliability(truth, p)
    assert [each.n for each in bins] == [1, 2, 0, 0, 0, 0, 0, 0, 0, 2]
    assert (bins[1].p_suspicious, bins[1].suspicious) == (pytest.approx(0.135), 0.5)
    assert (bins[9].low, bins[9].high, bins[9].suspicious) == (pytest.approx(0.9), 1.0, 1.0)
    assert math.isnan(bins[4].suspicious)
