from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from mapq.crf.calibration import (
    SHARES,
    choose_calibration,
    cut_probability,
    fit_isotonic,
    fit_platt,
    fit_temperature,
    keep_sides,
    log_loss,
    operating_points,
    probabilities,
    with_false_alarms,
)
from mapq.model import ISOTONIC, PLATT, TEMPERATURE, Calibration
from prf.shell.errors import UsageError
from tests.mapq.assess.test_result import make_model


def draw(log_odds, n=20000, seed=0, scale=2.0):
    """Return differences, labels whose log-odds are a function of them, best labels, and folds."""
    rng = np.random.default_rng(seed)
    difference = rng.normal(scale=scale, size=n)
    y = np.where(rng.random(n) < expit(log_odds(difference)), 1.0, -1.0)
    return difference, y, (difference >= 0.0).astype(np.uint8), np.arange(n) % 5


@pytest.mark.parametrize("threshold", [0.0, 1.5, -0.5])
def test_a_probability_is_on_the_side_of_its_label_even_where_it_ties(threshold):
    model = replace(make_model(), calibration=Calibration(slope=2.0), threshold=threshold)
    difference = threshold + np.array([0.0, 1e-12, -1e-12, 3.0, -3.0, 1e4, -1e4])
    label = np.array([1, 1, 0, 1, 0, 1, 0], np.uint8)
    p, cut = probabilities(difference, label, model), cut_probability(model)
    assert cut == pytest.approx(expit(2.0 * threshold))
    assert p.dtype == np.float32
    np.testing.assert_array_equal(p > np.float32(cut), label == 1)
    np.testing.assert_array_equal(p < np.float32(cut), label == 0)
    np.testing.assert_allclose(p[3:5], expit(2.0 * difference[3:5]), rtol=1e-6)
    assert ((p >= 0.0) & (p <= 1.0)).all()


def test_the_best_labelling_is_cut_at_one_half_whatever_the_calibration():
    model = replace(make_model(), calibration=Calibration(PLATT, 1.0, -2.0))
    assert cut_probability(model) == 0.5
    p = probabilities(np.array([0.5, 1.0, 4.0, -1.0]), np.array([1, 1, 1, 0], np.uint8), model)
    assert (p[:2] > 0.5).all()
    np.testing.assert_allclose(p[2:], expit([2.0, -3.0]), rtol=1e-6)


@pytest.mark.parametrize("cut", [0.0, 0.5, 1.0])
def test_a_probability_stays_one_beside_any_cut(cut):
    p = keep_sides(np.array([0.0, cut, 1.0, 0.0, cut, 1.0]), np.array([0, 0, 0, 1, 1, 1], np.uint8), cut)
    assert ((p >= 0.0) & (p <= 1.0)).all()
    assert (np.abs(p[[1, 4]] - np.float32(cut)) <= np.spacing(np.float32(cut))).all(), "moved by no more than it must"


@pytest.mark.parametrize("temperature", [0.2, 1.0, 4.0])
def test_the_temperature_that_made_the_labels_is_found(temperature):
    difference, y, _, _ = draw(lambda d: temperature * d, scale=2.0 / temperature)
    found = fit_temperature(difference, y)
    assert found.slope == pytest.approx(temperature, rel=0.06)
    assert log_loss(difference, y, found) < log_loss(difference, y, Calibration(slope=1.3 * found.slope))


def test_the_loss_is_that_of_the_labels_probabilities():
    difference, y = np.array([1.0, -2.0, 0.5]), np.array([1.0, 1.0, -1.0])
    p = 1.0 / (1.0 + np.exp(-(1.5 * difference - 0.3)))
    expected = -(np.log(p[0]) + np.log(p[1]) + np.log(1.0 - p[2])) / 3.0
    assert log_loss(difference, y, Calibration(PLATT, 1.5, -0.3)) == pytest.approx(expected, rel=1e-12)


def test_the_shift_that_made_the_labels_is_found():
    difference, y, _, _ = draw(lambda d: 0.7 * d - 1.2)
    found = fit_platt(difference, y)
    assert (found.slope, found.intercept) == (pytest.approx(0.7, rel=0.06), pytest.approx(-1.2, rel=0.06))


def test_the_curve_that_made_the_labels_is_found():
    difference, y, _, _ = draw(lambda d: 3.0 * np.tanh(2.0 * d))
    found = fit_isotonic(difference, y)
    at = np.linspace(-3.0, 3.0, 13)
    np.testing.assert_allclose(expit(found.log_odds(at)), expit(3.0 * np.tanh(2.0 * at)), atol=0.05)
    rising = found.log_odds(np.linspace(-50.0, 50.0, 1001))
    assert (np.diff(rising) > 0.0).all()


def test_patches_that_are_all_right_keep_some_doubt():
    y = np.array([1.0, -1.0] * 10)
    found = fit_temperature(3.0 * y, y)
    assert expit(found.log_odds(np.array([3.0])))[0] == pytest.approx(11 / 12, rel=1e-4)
    for fit in (fit_platt, fit_isotonic):
        p = expit(fit(3.0 * y, y).log_odds(np.array([-3.0, 3.0])))
        assert p[0] < 0.1 < 0.9 < p[1] < 0.97


@pytest.mark.parametrize(
    ("log_odds", "kind"),
    [(lambda d: 1.3 * d, TEMPERATURE), (lambda d: np.where(d < 0.0, 2.0 * d, 0.2 * d), ISOTONIC)],
)
def test_the_kind_is_chosen_by_folds_that_it_had_not_seen(log_odds, kind):
    chosen = choose_calibration(*draw(log_odds))
    assert chosen.calibration.kind == kind
    assert set(chosen.losses) == {TEMPERATURE, PLATT, ISOTONIC}
    assert chosen.losses[kind] == min(chosen.losses.values())


def test_probabilities_of_the_choice_come_from_other_folds():
    difference, y, label, fold = draw(lambda d: 1.3 * d, 4000)
    chosen = choose_calibration(difference, y, label, fold)
    inside = fold == 2
    refitted = fit_temperature(difference[~inside], y[~inside])
    np.testing.assert_allclose(chosen.probability[inside], expit(refitted.log_odds(difference[inside])), atol=1e-6)


def test_one_fold_is_nothing_to_choose_by():
    difference, y, label, fold = draw(lambda d: 1.3 * d, 400)
    chosen = choose_calibration(difference, y, label, np.zeros_like(fold))
    assert (chosen.calibration.kind, chosen.losses) == (TEMPERATURE, {})
    assert np.isfinite(chosen.probability).all()


def test_operating_points_keep_to_their_false_alarms():
    difference, y, _, _ = draw(lambda d: 1.5 * d, 3000)
    points = operating_points(difference, y)
    assert tuple(points[:, 0]) == SHARES
    for share, threshold, recall in points:
        called = difference >= threshold
        assert called[y < 0.0].mean() <= share
        assert called[y > 0.0].mean() == recall
        one_more = np.sort(difference[(y < 0.0) & ~called])[-1]
        assert (difference[y < 0.0] >= one_more).mean() > share
    assert (np.diff(points[:, 1]) <= 0.0).all()


def test_an_operating_point_is_the_next_smaller_one():
    points = operating_points(*draw(lambda d: 1.5 * d, 3000)[:2])
    model = replace(make_model(), operating=points)
    for share, used in ((0.02, 0.02), (0.022, 0.02), (0.0, 0.0), (1.0, 0.5)):
        assert with_false_alarms(model, share, "m").threshold == points[SHARES.index(used), 1]
    assert operating_points(np.ones(3), np.ones(3)).shape == (0, 3)
    with pytest.raises(UsageError, match=r"m\.json has no operating points"):
        with_false_alarms(make_model(), 0.02, "m.json")
