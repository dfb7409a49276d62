from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest

from mapq.crf import TrainingMap, TrainSettings, classify, train
from mapq.crf.margin import BIAS_PRECISION, GAP, MarginFit, fit_margin, make_part
from mapq.crf.quadratic import solve_quadratic
from mapq.crf.select import MARGIN_STRENGTHS
from mapq.crf.train import MAX_MARGIN, Strength, margin_weights, precisions, prepare, signs
from mapq.evaluate import area_under_curve
from mapq.model import EDGE_MODELS, FULL, NONE
from mapq.patches import UNLABELLED
from tests.mapq.crf.worlds import draw_map
from tests.reference.mapq_crf import draw_features


def small_parts(seed, edge_model, n_maps=2, n_patches=6):
    """Return parts of maps small enough to score every labelling, some patches without a label."""
    rng = np.random.default_rng(seed)
    maps = []
    for _ in range(n_maps):
        label = rng.integers(0, 2, n_patches).astype(np.uint8)
        label[0] = UNLABELLED
        label[1:3] = 0, 1
        maps.append(TrainingMap(draw_features(rng, n_patches, 9), label, np.zeros(n_patches, int)))
    prepared = prepare(maps, TrainSettings(edge_model))
    parts = []
    for inputs, unary, each in zip(prepared.inputs, prepared.unary, maps, strict=True):
        y = signs(each.label)
        parts.append(make_part(inputs, unary, y, np.where(y > 0.0, 1.5, 0.7) * (y != 0.0)))
    return parts


def slow_risk(part, weights, n_coupling):
    """The structured hinge loss of a part, over all labellings."""
    true = part.joint(part.y, n_coupling) @ weights
    values = []
    for labels in itertools.product((-1.0, 1.0), repeat=len(part.y)):
        y = np.array(labels)
        values.append(part.cost[y != part.y].sum() + part.joint(y, n_coupling) @ weights - true)
    return max(values)


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_the_cut_finds_the_labelling_that_breaks_the_margin_most(edge_model, seed):
    n_coupling = 0 if edge_model == NONE else 2
    rng = np.random.default_rng(seed)
    for part in small_parts(seed, edge_model):
        weights = rng.normal(size=part.unary.shape[1] + n_coupling)
        weights[len(weights) - n_coupling :] = np.abs(weights[len(weights) - n_coupling :])
        y = part.worst(weights)
        found = part.cost[y != part.y].sum() + (part.joint(y, n_coupling) - part.joint(part.y, n_coupling)) @ weights
        assert found == pytest.approx(slow_risk(part, weights, n_coupling), abs=1e-8)


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
@pytest.mark.parametrize("seed", range(3))
def test_no_weights_are_better_than_the_bound_says(edge_model, seed):
    parts = small_parts(seed, edge_model)
    n_coupling = 0 if edge_model == NONE else 2
    precision = precisions(parts[0].unary.shape[1], edge_model, Strength(0.5, 2.0))
    found = fit_margin(parts, edge_model, precision)
    precision[0] = BIAS_PRECISION

    def objective(weights):
        risk = sum(slow_risk(part, weights, n_coupling) for part in parts)
        return 0.5 * precision @ weights**2 + risk

    assert found.objective == pytest.approx(objective(found.weights), rel=1e-9)
    assert found.bound >= (1.0 - GAP) * found.objective
    if n_coupling:
        assert (found.weights[-2:] >= 0.0).all()
    rng = np.random.default_rng(seed)
    for scale in (0.001, 0.01, 0.1, 1.0):
        for _ in range(10):
            other = found.weights + scale * rng.normal(size=len(precision))
            other[len(other) - n_coupling :] = np.abs(other[len(other) - n_coupling :])
            assert objective(other) >= found.bound


def uneven_maps(balanced=True):
    """Three maps with 3, 5 and 4 labelled patches, more plausible than suspicious."""
    rng = np.random.default_rng(8)
    maps = []
    for n_labelled in (3, 5, 4):
        label = np.full(6, UNLABELLED, np.uint8)
        label[:n_labelled] = (np.arange(n_labelled) % 3 == 1).astype(np.uint8)
        maps.append(TrainingMap(draw_features(rng, 6, 9), label, np.zeros(6, int)))
    settings = TrainSettings(FULL, objective=MAX_MARGIN, balanced=balanced)
    return maps, settings, prepare(maps, settings)


@pytest.mark.parametrize("balanced", [False, True])
def test_a_wrong_label_costs_what_its_class_is_short_of(balanced):
    maps, settings, prepared = uneven_maps(balanced)
    labels = [each.label for each in maps]
    known = np.concatenate(labels)
    share = {0: np.sum(known == 0) / np.sum(known < 2), 1: np.sum(known == 1) / np.sum(known < 2)}
    assert share[0] > 1.5 * share[1]
    parts = []
    for inputs, unary, label in zip(prepared.inputs, prepared.unary, labels, strict=True):
        cost = [0.0 if one > 1 else 0.5 / share[int(one)] if balanced else 1.0 for one in label]
        parts.append(make_part(inputs, unary, signs(label), np.array(cost)))
    strength = Strength(0.5, 2.0)
    expected = fit_margin(parts, FULL, precisions(prepared.unary[0].shape[1], FULL, strength))
    found = margin_weights(prepared, labels, settings, strength)
    np.testing.assert_array_equal(found, expected.weights)
    assert np.abs(found).max() > 0.01


@pytest.mark.parametrize(("objective", "share", "warns"), [(2.0, 1.0, False), (0.5, 0.999, True), (2.0, 0.999, True)])
def test_too_few_rounds_are_said(monkeypatch, caplog, objective, share, warns):
    maps, settings, prepared = uneven_maps()
    fit = MarginFit(np.zeros(1), objective, share * (1.0 - GAP) * objective, 1)
    monkeypatch.setattr(sys.modules[margin_weights.__module__], "fit_margin", lambda *_: fit)
    margin_weights(prepared, [each.label for each in maps], settings, Strength(0.5, 2.0))
    assert bool(caplog.messages) == warns


def test_the_quadratic_program_meets_its_optimality_conditions():
    rng = np.random.default_rng(1)
    for n, m in ((3, 5), (8, 40), (12, 4)):
        left, right = rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m)
        curvature, slope = rng.uniform(0.01, 2.0, n), rng.normal(size=n)
        z, multiplier = solve_quadratic(curvature, slope, left, right)
        assert (left @ z <= right + 1e-8).all()
        assert (multiplier > 0.0).all()
        np.testing.assert_allclose(curvature * z + slope + left.T @ multiplier, 0.0, atol=1e-8)
        np.testing.assert_allclose(multiplier * (right - left @ z), 0.0, atol=1e-8)


def test_a_patch_alone_is_a_support_vector_machine():
    """Without edges the risk is the sum of hinge losses max(0, cost - 2 y s)."""
    parts = small_parts(5, NONE)
    weights = np.random.default_rng(0).normal(size=parts[0].unary.shape[1])
    for part in parts:
        hinge = np.maximum(0.0, part.cost - 2.0 * part.y * (part.unary @ weights)).sum()
        assert slow_risk(part, weights, 0) == pytest.approx(hinge)


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_it_labels_maps_that_it_has_not_seen(edge_model):
    maps = [draw_map(seed) for seed in (1, 2)]
    settings = TrainSettings(edge_model, objective=MAX_MARGIN)
    trained, again = train(maps, settings), train(maps, settings)
    np.testing.assert_array_equal(trained.model.weights, again.model.weights)
    assert {strength.weights for strength in trained.scores} == set(MARGIN_STRENGTHS)
    plain = train(maps, TrainSettings(edge_model))
    others = [draw_map(seed) for seed in (3, 4, 5)]
    assert area(others, trained.model) > area(others, plain.model) - 0.02


def area(maps, model):
    """Return the area under the curve over all patches of some maps."""
    found = [classify(each.features, model) for each in maps]
    true = np.concatenate([each.label for each in maps]) == 1
    return area_under_curve(np.concatenate([each.difference for each in found]), true)


def test_labels_that_weigh_nothing_to_tell_still_train():
    one = draw_map(1)
    label = np.full(len(one.label), UNLABELLED, np.uint8)
    label[[np.flatnonzero(one.label == 1)[0], np.flatnonzero(one.label == 0)[0]]] = 1, 0
    model = train([one._replace(label=label)], TrainSettings(FULL, objective=MAX_MARGIN)).model
    assert np.isfinite(model.weights).all()
