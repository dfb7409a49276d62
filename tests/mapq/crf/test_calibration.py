"""Calibrations on few patches, by their definitions: written-out losses, pooled groups, folds one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit

from mapq.crf.calibration import (
    FITS,
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
from mapq.model import ISOTONIC, LEAST_SLOPE, PLATT, TEMPERATURE, Calibration
from prf.shell.errors import UsageError
from tests.mapq.results.test_result import make_model


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


def test_patches_that_are_all_right_keep_some_doubt():
    y = np.array([1.0, -1.0] * 10)
    found = fit_temperature(3.0 * y, y)
    assert expit(found.log_odds(np.array([3.0])))[0] == pytest.approx(11 / 12, rel=1e-4)
    for fit in (fit_platt, fit_isotonic):
        p = expit(fit(3.0 * y, y).log_odds(np.array([-3.0, 3.0])))
        assert p[0] < 0.1 < 0.9 < p[1] < 0.97


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


def some_patches(seed, n, shift=0.0):
    """Return differences, labels by a shifted logistic curve with both kinds among them, best labels."""
    rng = np.random.default_rng(seed)
    difference = rng.normal(scale=2.0, size=n)
    y = np.where(rng.random(n) < 1.0 / (1.0 + np.exp(-0.8 * difference - shift)), 1.0, -1.0)
    y[:2] = 1.0, -1.0
    return difference, y, (difference >= 0.0).astype(np.uint8)


def slow_loss(difference, y, slope, intercept):
    """The mean log-loss against Platt's targets, patch by patch."""
    n_suspicious, n_plausible = int((y > 0).sum()), int((y < 0).sum())
    total = 0.0
    for d, label in zip(difference, y, strict=True):
        target = (n_suspicious + 1) / (n_suspicious + 2) if label > 0 else 1 / (n_plausible + 2)
        p = 1.0 / (1.0 + math.exp(-(slope * d + intercept)))
        total -= target * math.log(p) + (1.0 - target) * math.log(1.0 - p)
    return total / len(y)


def best(difference, y, n_free):
    """Slope and intercept of least loss, by a search without slopes; the slope alone with `n_free` 1."""
    found = minimize(
        lambda x: slow_loss(difference, y, x[0], x[1] if n_free == 2 else 0.0),
        np.array([0.5, 0.1])[:n_free],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-15, "maxiter": 4000},
    )
    return found.x


@pytest.mark.parametrize("seed", range(4))
def test_temperature_and_slope_are_those_of_least_loss(seed):
    difference, y, _ = some_patches(seed, 19, shift=1.0)
    assert fit_temperature(difference, y).slope == pytest.approx(best(difference, y, 1)[0], rel=1e-5)
    found = fit_platt(difference, y)
    assert (found.kind, found.slope, found.intercept) == (PLATT, *map(near, best(difference, y, 2)))


def near(value):
    return pytest.approx(value, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(("size", "slope"), [(1e-6, 1e3), (-1e-6, 1e-3), (1e6, 1e-3)])
def test_slopes_end_at_their_bounds(size, slope):
    y = np.array([1.0, -1.0] * 10)
    assert fit_temperature(size * y, y).slope == pytest.approx(slope, rel=1e-4)
    assert fit_platt(size * y, y).slope == pytest.approx(slope, rel=1e-4)


def slow_isotonic(difference, y, n_groups):
    """Knots (k, 2) of the pooled groups: neighbours that fall are pooled until none does."""
    order = sorted(range(len(y)), key=lambda i: (difference[i], y[i]))
    groups = [list(group) for group in np.array_split(order, n_groups)]
    blocks = []
    while groups:  # What is of the difference of the last one goes with it, if that are more than a group.
        block = groups.pop(0)
        tied = [i for i in order if difference[i] == difference[block[-1]]]
        rest = [i for group in groups for i in group]
        n_more = sum(difference[i] == difference[block[-1]] for i in rest)
        if n_more and len(tied) > len(y) / n_groups:
            block, groups = block + rest[:n_more], [[i for i in group if i not in tied] for group in groups]
        blocks.append(block)
        while groups and len(groups[0]) < 10:  # What is left of a group goes with the next.
            left = groups.pop(0)
            if groups:
                groups[0] = left + groups[0]
            else:
                blocks[-1] = block + left

    def share(block):
        return np.mean([y[i] > 0 for i in block])

    place = 0
    while place + 1 < len(blocks):
        if share(blocks[place]) > share(blocks[place + 1]):
            blocks[place : place + 2] = [blocks[place] + blocks[place + 1]]
            place = max(place - 1, 0)
        else:
            place += 1
    same = [0]
    for k in range(1, len(blocks)):  # Blocks of one share are one.
        if share(blocks[k]) == share(blocks[same[-1]]):
            blocks[same[-1]] = blocks[same[-1]] + blocks[k]
        else:
            same.append(k)
    knots = []
    for k in same:
        n_suspicious, n = sum(y[i] > 0 for i in blocks[k]), len(blocks[k])
        at, p = np.mean([difference[i] for i in blocks[k]]), (n_suspicious + 1.0) / (n + 2.0)
        value = max([math.log(p / (1.0 - p)), *(before for _, before in knots)])
        if not knots or at > knots[-1][0]:
            knots.append((at, value))
    return np.array([(at, value + LEAST_SLOPE * (at - knots[0][0])) for at, value in knots])


@pytest.mark.parametrize(("n", "n_groups"), [(20, 2), (49, 4), (305, 30), (2030, 100)])
def test_the_isotonic_curve_is_that_of_pooled_groups(n, n_groups):
    difference, y, _ = some_patches(n, n)
    found = fit_isotonic(difference, y)
    assert found.kind == ISOTONIC
    np.testing.assert_allclose(found.knots, slow_isotonic(difference, y, n_groups), rtol=1e-12)


def test_blocks_of_one_difference_make_one_knot():
    """What hangs together has one difference, and one probability: the share of it that is suspicious."""
    difference = np.repeat([-1.0, 2.0], [40, 20])
    y = np.where(np.arange(60) < 25, -1.0, 1.0)
    found = fit_isotonic(difference, y)
    np.testing.assert_allclose(found.knots, slow_isotonic(difference, y, 6), rtol=1e-12)
    assert found.knots[:, 0].tolist() == [-1.0, 2.0]
    np.testing.assert_allclose(expit(found.log_odds(np.array([-1.0, 2.0]))), [16 / 42, 21 / 22], atol=1e-3)


@pytest.mark.parametrize(("n_below", "n_tied", "n_above"), [(60, 40, 60), (13, 27, 44), (5, 31, 4), (600, 900, 500)])
def test_patches_that_hang_together_are_not_parted_by_their_labels(n_below, n_tied, n_above):
    rng = np.random.default_rng(n_below)
    difference = np.concatenate([rng.normal(-4, 0.5, n_below), np.full(n_tied, 1.5), rng.normal(6, 0.5, n_above)])
    tied = np.where(np.arange(n_tied) < 0.6 * n_tied, 1.0, -1.0)
    y = np.concatenate([np.full(n_below, -1.0), tied, np.ones(n_above)])
    found = fit_isotonic(difference, y)
    if found.kind == ISOTONIC:
        np.testing.assert_allclose(found.knots, slow_isotonic(difference, y, min(100, len(y) // 10)), rtol=1e-12)
        assert expit(found.log_odds(np.array([1.5])))[0] == pytest.approx(0.6, abs=0.12)


@pytest.mark.parametrize(("n_tied", "last"), [(4, 29.5), (10, 27.55), (11, 33.0)])
def test_few_patches_of_one_difference_may_be_parted(n_tied, last):
    """About the border of two of four groups; from one more than a group on they stay together."""
    difference = np.arange(40.0)
    difference[16 : 16 + n_tied] = 16.0
    y = np.where(np.arange(40) < 19, -1.0, 1.0)
    found = fit_isotonic(difference, y)
    np.testing.assert_allclose(found.knots, slow_isotonic(difference, y, 4), rtol=1e-12)
    assert found.knots[-1, 0] == pytest.approx(last)


def same(one, other):
    return (one.kind, one.slope, one.intercept) == (other.kind, other.slope, other.intercept)


def slow_choice(difference, y, label, fold, kind):
    """Losses and probabilities of one kind, fold by fold; folds without which one label is left are filled at last."""
    losses, p = [], np.zeros(len(y))
    for number in sorted(set(fold.tolist())):
        inside = fold == number
        if len(set(y[~inside].tolist())) < 2:
            p[inside] = curve(FITS[kind](difference, y), difference[inside], label[inside])
            continue
        p[inside] = curve(FITS[kind](difference[~inside], y[~inside]), difference[inside], label[inside])
        for value, true in zip(p[inside], y[inside], strict=True):
            chance = min(max(value, 1e-6), 1.0 - 1e-6)
            losses.append(-math.log(chance if true > 0 else 1.0 - chance))
    return np.mean(losses), p


def curve(calibration, difference, label):
    return keep_sides(1.0 / (1.0 + np.exp(-calibration.log_odds(difference))), label).astype(float)


@pytest.mark.parametrize("seed", range(3))
def test_losses_and_probabilities_are_those_of_each_fold_by_itself(seed):
    difference, y, label = some_patches(seed, 61, shift=0.5)
    fold = np.random.default_rng(seed).integers(0, 3, 61)
    if seed == 1:
        fold = np.where(y > 0.0, 0, 1 + fold % 2)  # Without fold 0 all are plausible.
    if seed == 2:  # Two folds, and a patch of each label far on the wrong side.
        fold = np.minimum(fold, 1)
        wrong = [np.argmax(y), np.argmin(y)]
        difference[wrong], fold[wrong] = (-700.0, 700.0), 0
        label = (difference >= 0.0).astype(np.uint8)
    chosen = choose_calibration(difference, y, label, fold)
    for kind in FITS:
        loss, p = slow_choice(difference, y, label, fold, kind)
        assert chosen.losses[kind] == pytest.approx(loss, rel=1e-9)
        if kind == chosen.calibration.kind:
            np.testing.assert_allclose(chosen.probability, p, rtol=1e-7)
    assert chosen.losses[chosen.calibration.kind] == min(chosen.losses.values())
    assert chosen.calibration.kind in FITS
    np.testing.assert_array_equal(
        chosen.calibration.log_odds(difference), FITS[chosen.calibration.kind](difference, y).log_odds(difference)
    )


def test_of_kinds_that_are_alike_the_simplest_is_chosen():
    """Patches of two labels and one difference each: a slope fits what any curve does."""
    y = np.array([1.0, -1.0] * 9)
    chosen = choose_calibration(y, y, (y > 0).astype(np.uint8), np.arange(18) // 2 % 3)
    assert chosen.losses[PLATT] == chosen.losses[ISOTONIC]
    assert chosen.calibration.kind in (TEMPERATURE, PLATT)


def test_one_fold_leaves_the_temperature_of_all():
    difference, y, label = some_patches(3, 30)
    chosen = choose_calibration(difference, y, label, np.full(30, 7))
    assert same(chosen.calibration, fit_temperature(difference, y))
    assert chosen.losses == {}
    np.testing.assert_allclose(chosen.probability, curve(chosen.calibration, difference, label), rtol=1e-12)
