from __future__ import annotations

import itertools
import sys

import numpy as np
import pytest

from mapq.configuration import TrainSettings
from mapq.crf import classify, max_margin
from mapq.crf.cross_validation import MARGIN_STRENGTHS, train
from mapq.crf.max_margin import BIAS_PRECISION, GAP, MapPart, MarginFit, fit_margin, make_part, solve_quadratic
from mapq.crf.train import Strength, TrainingMap, margin_weights, precisions, prepare, signs
from mapq.labels import UNLABELLED
from mapq.model import EDGE_MODELS, NONE, SYMMETRIC, Model, parameter_names
from mapq.results.evaluate import area_under_curve
from tests.mapq.crf.worlds import draw_map
from tests.reference.mapq_crf import draw_features, slow_score


def small_maps(rng, n_maps=2, n_patches=6):
    """Return maps small enough to score every labelling, some patches without a label."""
    maps = []
    for _ in range(n_maps):
        label = rng.integers(0, 2, n_patches).astype(np.uint8)
        label[0] = UNLABELLED
        label[1:3] = 0, 1
        maps.append(TrainingMap(draw_features(rng, n_patches, 9), label, np.zeros(n_patches, int)))
    return maps


def parts_of(prepared, maps):
    parts = []
    for inputs, unary, each in zip(prepared.inputs, prepared.unary, maps, strict=True):
        y = signs(each.label)
        parts.append(make_part(inputs, unary, y, np.where(y > 0.0, 1.5, 0.7) * (y != 0.0)))
    return parts


def small_parts(seed, edge_model):
    maps = small_maps(np.random.default_rng(seed))
    return parts_of(prepare(maps, TrainSettings(potential="linear", edge_model=edge_model)), maps)


def slow_risk(part, weights, n_coupling):
    """The structured hinge loss of a part, over all labellings."""
    true = part.joint(part.y, n_coupling) @ weights
    values = []
    for labels in itertools.product((-1.0, 1.0), repeat=len(part.y)):
        y = np.array(labels)
        values.append(part.cost[y != part.y].sum() + part.joint(y, n_coupling) @ weights - true)
    return max(values)


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_a_part_scores_labels_as_the_definition_does_with_0_for_no_label(edge_model):
    rng = np.random.default_rng(6)
    maps = small_maps(rng)
    maps[1].label[3] = UNLABELLED
    prepared = prepare(maps, TrainSettings(potential="linear", edge_model=edge_model))
    weights = rng.normal(size=len(parameter_names(edge_model, prepared.node.names)))
    model = Model(edge_model, {}, prepared.node, prepared.x_range, weights)
    n_coupling = 0 if edge_model == NONE else 2
    for part, each in zip(parts_of(prepared, maps), maps, strict=True):
        for _ in range(8):
            y = np.where(signs(each.label) == 0.0, 0.0, rng.choice([-1.0, 1.0], len(each.label)))
            score = part.joint(y[y != 0.0], n_coupling) @ weights
            assert score == pytest.approx(slow_score(each.features, model, y.tolist()), abs=1e-10)


def test_pairs_without_weights_of_a_coupling_have_none():
    part = MapPart(
        np.array([[1.0], [-1.0]]), np.array([[0, 1]]), np.array([0.5]), np.ones(1), np.array([1.0, 1.0]), np.zeros(2)
    )
    assert part.worst(np.array([0.25])).tolist() == [1.0, -1.0]


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
@pytest.mark.parametrize("seed", range(4))
def test_the_cut_finds_the_labelling_that_breaks_the_margin_most(edge_model, seed):
    n_coupling = 0 if edge_model == NONE else 2
    rng = np.random.default_rng(seed)
    for part in small_parts(seed, edge_model):
        part = part._replace(share=rng.uniform(0.2, 1.0, len(part.pairs)))
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


def lone_part(features, cost):
    """One suspicious patch."""
    return MapPart(
        np.array([features]), np.empty((0, 2), np.int64), np.empty(0), np.empty(0), np.ones(1), np.array([cost])
    )


def test_the_bias_alone_is_as_weak_as_documented():
    """Of 0.001 w² / 2 + max(0, 1 - 2 w) the least is at w = 1/2."""
    found = fit_margin([lone_part([1.0], 1.0)], NONE, np.zeros(1))
    assert found.weights == pytest.approx([0.5], rel=1e-2)
    assert found.objective == pytest.approx(0.001 / 8.0, rel=1.1e-3)


@pytest.mark.parametrize(("bounds", "rounds"), [([998.0, 998.9, 999.0, 999.9], 3), ([998.0], 300)])
def test_the_search_ends_within_a_thousandth_of_the_optimum_or_after_300_rounds(monkeypatch, bounds, rounds):
    told = itertools.chain(bounds, itertools.repeat(bounds[-1]))
    monkeypatch.setattr(max_margin, "_master", lambda *_: (np.zeros(1), next(told)))
    found = fit_margin([lone_part([0.0], 1000.0)], NONE, np.zeros(1))
    assert (found.objective, found.n_rounds) == (1000.0, rounds)


@pytest.mark.parametrize("factor", [2.0, 5.0])
def test_the_bound_holds_however_rough_the_program_is(monkeypatch, factor):
    """Of 10 w² / 2 + 2 max(0, 1 - 2 w) the least is 1.2, at w = 0.4; multipliers have to sum to 1 a part."""

    def rough(*program):
        z, multiplier = solve_quadratic(*program)
        return z, factor * multiplier

    monkeypatch.setattr(max_margin, "solve_quadratic", rough)
    found = fit_margin([lone_part([0.0, 1.0], 1.0)] * 2, NONE, np.array([0.0, 10.0]))
    assert found.weights == pytest.approx([0.0, 0.4], abs=1e-2)
    assert found.objective == pytest.approx(1.2, rel=1e-3)
    assert found.bound == pytest.approx(1.2, rel=1e-6)


def test_the_optimum_is_the_same_in_other_units():
    """A feature 100,000 times as large, as sums over many patches are, and a prior on its weight as much tighter."""
    rng, unit, parts = np.random.default_rng(0), 1e5, []
    for _ in range(2):
        y = np.where(rng.random(25) < 0.4, 1.0, -1.0)
        unary = np.column_stack([np.ones(25), rng.normal(size=25) + 0.5 * y])
        parts.append(
            MapPart(unary, np.empty((0, 2), np.int64), np.empty(0), np.empty(0), y, np.where(y > 0.0, 1.5, 0.7))
        )
    found = fit_margin(parts, NONE, np.array([0.0, 0.1]))
    parts = [part._replace(unary=part.unary * [1.0, unit]) for part in parts]
    other = fit_margin(parts, NONE, np.array([0.0, 0.1 * unit**2]))
    for fit in (found, other):
        assert fit.bound >= 0.999 * fit.objective
    assert other.objective == pytest.approx(found.objective, rel=1e-3)
    assert other.bound <= found.objective


def uneven_maps(balanced=True):
    """Three maps with 3, 5 and 4 labelled patches, more plausible than suspicious."""
    rng = np.random.default_rng(8)
    maps = []
    for n_labelled in (3, 5, 4):
        label = np.full(6, UNLABELLED, np.uint8)
        label[:n_labelled] = (np.arange(n_labelled) % 3 == 1).astype(np.uint8)
        maps.append(TrainingMap(draw_features(rng, 6, 9), label, np.zeros(6, int)))
    settings = TrainSettings(
        potential="linear",
        edge_model=SYMMETRIC,
        objective="max-margin",
        class_weight="balanced" if balanced else "none",
    )
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
    expected = fit_margin(parts, SYMMETRIC, precisions(prepared.unary[0].shape[1], SYMMETRIC, strength))
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


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_the_quadratic_program_meets_its_optimality_conditions(unit):
    rng = np.random.default_rng(1)
    for n, m in ((3, 5), (8, 40), (12, 4)):
        left, right = rng.normal(size=(m, n)), rng.uniform(0.1, 1.0, m)
        curvature, slope = rng.uniform(0.01, 2.0, n), unit * rng.normal(size=n)
        z, multiplier = solve_quadratic(curvature, slope, left, right)
        assert (left @ z <= right + 1e-7).all()
        assert (multiplier >= 0.0).all()
        np.testing.assert_allclose(curvature * z + slope + left.T @ multiplier, 0.0, atol=1e-7 * unit)
        np.testing.assert_allclose(multiplier * (right - left @ z), 0.0, atol=1e-5 * unit)


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
    settings = TrainSettings(potential="linear", edge_model=edge_model, objective="max-margin")
    trained, again = train(maps, settings), train(maps, settings)
    np.testing.assert_array_equal(trained.model.weights, again.model.weights)
    assert {strength.weights for strength in trained.scores} == set(MARGIN_STRENGTHS)
    plain = train(maps, TrainSettings(potential="linear", edge_model=edge_model))
    others = [draw_map(seed) for seed in (3, 4, 5)]
    assert area(others, trained.model) > area(others, plain.model) - 0.02


def area(maps, model):
    """Return the area under the curve over all patches of some maps."""
    found = [classify(each.features, model) for each in maps]
    true = np.concatenate([each.label for each in maps]) == 1
    return area_under_curve(np.concatenate([each.difference for each in found]), true)
