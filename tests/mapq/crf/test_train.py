"""The standardisation of features by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import Bounds, check_grad, minimize

from mapq.configuration import TrainSettings
from mapq.crf import classify
from mapq.crf.cross_validation import COUPLING_SHARES, STRENGTHS, train
from mapq.crf.pseudo_likelihood import Problem, fit, gradient, hessian, objective
from mapq.crf.train import Strength, TrainingMap, fit_range, fit_scaling, fit_weights, make_problem, prepare, signs
from mapq.labels import UNLABELLED
from mapq.model import CLIP, EDGE_MODELS, NONE, SYMMETRIC, Model
from prf.shell.errors import ArgumentError, InputError
from tests.mapq.crf.worlds import draw_map
from tests.reference.mapq_crf import draw_features, slow_log_pseudo_likelihood


def linear(edge_model: str, **settings: object) -> TrainSettings:
    return TrainSettings(potential="linear", edge_model=edge_model, **settings)


"""Settings of the field that is linear in node features, as in the paper."""


def draw_problem(seed: int, n_patches: int = 60) -> Problem:
    """Return a problem in which either bound, both or none holds the optimum."""
    rng = np.random.default_rng(seed)
    design = np.column_stack([np.ones(n_patches), rng.normal(size=(n_patches, 4))])
    truth = rng.normal(size=5) * [0.5, 1, 1, 1, 1]
    y = np.where(rng.random(n_patches) < 1 / (1 + np.exp(-2 * design @ truth)), 1.0, -1.0)
    y[:2] = 1.0, -1.0
    precision = np.array([0.0, *[rng.choice([0.1, 1.0, 10.0])] * 4])
    return Problem(design, y, rng.uniform(0.5, 2.0, n_patches), precision, (3, 4))


def pseudo_model(maps, settings, regularisation):
    prepared = prepare(maps, settings)
    weights = fit_weights(prepared, [m.label for m in maps], settings, Strength(regularisation, regularisation))
    return Model(settings.edge_model, {}, prepared.node, prepared.x_range, weights)


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_the_objective_is_the_pseudo_likelihood_by_its_definition(edge_model):
    rng = np.random.default_rng(2)
    maps = []
    for n_patches, n_pairs in ((9, 14), (5, 4), (1, 0)):
        label = rng.integers(0, 2, n_patches).astype(np.uint8)
        maps.append(TrainingMap(draw_features(rng, n_patches, n_pairs), label, np.zeros(n_patches, int)))
    settings = linear(edge_model, class_weight="none")
    prepared = prepare(maps, settings)
    problem = make_problem(prepared, [m.label for m in maps], settings, Strength(0.0, 0.0))
    weights = rng.normal(size=problem.design.shape[1])
    model = Model(edge_model, {}, prepared.node, prepared.x_range, weights)
    assert objective(problem, weights) == pytest.approx(-slow_log_pseudo_likelihood(maps, model), rel=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_gradient_and_hessian_are_the_differences(seed):
    problem = draw_problem(seed)
    weights = np.random.default_rng(seed).normal(size=5)
    assert check_grad(lambda w: objective(problem, w), lambda w: gradient(problem, w), weights) < 1e-4
    step = 1e-6
    for index, row in enumerate(hessian(problem, weights)):
        shift = step * np.eye(5)[index]
        slope = (gradient(problem, weights + shift) - gradient(problem, weights - shift)) / (2 * step)
        np.testing.assert_allclose(row, slope, atol=1e-5)


@pytest.mark.parametrize("seed", range(12))
def test_the_optimum_is_that_of_a_generic_solver(seed):
    problem = draw_problem(seed)
    found = fit(problem)
    bounds = Bounds([-np.inf] * 3 + [0.0] * 2, [np.inf] * 5)
    other = minimize(
        lambda w: objective(problem, w),
        np.full(5, 0.1),
        jac=lambda w: gradient(problem, w),
        method="trust-constr",
        bounds=bounds,
        options={"gtol": 1e-9, "xtol": 1e-12, "maxiter": 2000},
    )
    assert (found[3:] >= 0.0).all()
    assert objective(problem, found) <= other.fun + 1e-9
    np.testing.assert_allclose(found, other.x, atol=2e-3)
    slope = gradient(problem, found)
    free = np.array([True, True, True, *(found[3:] > 0.0)])
    assert np.abs(slope[free]).max() < 1e-5
    assert (slope[~free] >= -1e-9).all(), "a weight at its bound would like to leave the box"


def test_separable_labels_give_finite_weights():
    x = np.linspace(-1.0, 1.0, 40)
    problem = Problem(
        np.column_stack([np.ones(40), x]), np.where(x > 0, 1.0, -1.0), np.ones(40), np.array([0.0, 1e-4]), ()
    )
    weights = fit(problem)
    assert np.isfinite(weights).all()
    assert weights[1] > 3.0
    assert np.abs(gradient(problem, weights)).max() < 1e-6


@pytest.mark.parametrize("seed", [57, 60, 158])
def test_the_optimum_is_found_where_a_whole_step_goes_too_far(seed):
    """Features over many orders of magnitude: Newton's step has to be cut to a half or to a thirtieth."""
    rng = np.random.default_rng(seed)
    n_patches = rng.integers(4, 12)
    design = np.column_stack([np.ones(n_patches), rng.standard_cauchy((n_patches, 2)) ** 3])
    y = np.where(rng.random(n_patches) < 0.5, 1.0, -1.0)
    y[:2] = 1.0, -1.0
    problem = Problem(design, y, np.ones(n_patches), np.array([0.0, 1e-4, 1e-4]), ())
    assert np.abs(gradient(problem, fit(problem))).max() < 1e-6


def test_an_unlabelled_patch_counts_as_label_zero_for_its_neighbours():
    rng = np.random.default_rng(3)
    features = draw_features(rng, 12, 25)
    label = rng.integers(0, 2, 12).astype(np.uint8)
    label[4] = UNLABELLED
    settings = linear(SYMMETRIC)
    prepared = prepare([TrainingMap(features, label, np.zeros(12, int))], settings)
    problem = make_problem(prepared, [label], settings, Strength(1.0, 1.0))
    assert len(problem.y) == 11
    half = [
        make_problem(prepared, [np.where(label == UNLABELLED, y, label)], settings, Strength(1.0, 1.0)) for y in (0, 1)
    ]
    kept = np.arange(12) != 4
    np.testing.assert_allclose(problem.design, 0.5 * (half[0].design + half[1].design)[kept])
    assert signs(label)[4] == 0.0


def test_edges_beat_nodes_alone_and_regularisation_is_chosen():
    maps = [draw_map(seed, node_signal=1.0, share_unlabelled=0.2) for seed in (1, 2)]
    paired, alone = train(maps, linear(SYMMETRIC)), train(maps, linear(NONE))
    assert min(paired.scores.values()) < 0.9 * min(alone.scores.values())
    assert paired.scores[paired.strength] == min(paired.scores.values())
    assert paired.n_folds == 5
    n_labelled = sum(int((m.label != UNLABELLED).sum()) for m in maps)
    assert len(paired.held_out.truth) == n_labelled, "each labelled patch is held out once"
    assert (paired.held_out.truth == paired.held_out.label).mean() > 0.7


def test_training_repeats_and_does_not_depend_on_the_order_of_pairs():
    maps = [draw_map(1), draw_map(2)]
    first, again = train(maps, linear(SYMMETRIC)), train(maps, linear(SYMMETRIC))
    np.testing.assert_array_equal(first.model.weights, again.model.weights)
    order = np.random.default_rng(0).permutation(len(maps[0].features.pairs))
    one = maps[0].features
    turned = one._replace(pairs=one.pairs[order], edge=one.edge[order], plausibility=one.plausibility[order])
    shuffled = train([maps[0]._replace(features=turned), maps[1]], linear(SYMMETRIC))
    np.testing.assert_allclose(shuffled.model.weights, first.model.weights, rtol=1e-7)


def test_balance_finds_more_of_the_rare_label():
    maps = [draw_map(seed, node_signal=0.5) for seed in (1, 2)]
    plain = train(maps, linear(NONE, class_weight="none"))
    balanced = train(maps, linear(NONE, class_weight="balanced"))
    assert balanced.held_out.label.mean() > plain.held_out.label.mean() + 0.1


def test_both_labels_weigh_alike_by_default():
    maps = [draw_map(1)]
    prepared, labels = prepare(maps, linear(SYMMETRIC)), [m.label for m in maps]
    problem = make_problem(prepared, labels, linear(SYMMETRIC), Strength(1.0, 1.0))
    assert problem.importance[problem.y > 0].sum() == pytest.approx(0.5 * len(problem.y))
    assert problem.importance[problem.y < 0].sum() == pytest.approx(0.5 * len(problem.y))


@pytest.mark.parametrize(("edge_model", "coupling"), [(NONE, []), (SYMMETRIC, [7.0, 7.0])])
def test_the_bias_of_nodes_has_no_prior_and_the_coupling_one_of_its_own(edge_model, coupling):
    one, settings = draw_map(1), linear(edge_model)
    problem = make_problem(prepare([one], settings), [one.label], settings, Strength(3.0, 7.0))
    n_weights = problem.design.shape[1]
    assert problem.precision.tolist() == [0.0, *[3.0] * (n_weights - 1 - len(coupling)), *coupling]


@pytest.mark.parametrize(
    "settings",
    [
        {"objective": "max_margin"},
        {"edge_model": "all"},
        {"regularisation": -50.0},
        {"coupling_regularisation": 0.0},
        {"regularisation": np.nan},
        {"regularisation": np.inf},
        {"folds": 1},
    ],
)
def test_settings_that_would_train_something_else_are_refused(settings):
    with pytest.raises(ArgumentError, match=f"^{next(iter(settings))}"):
        TrainSettings(**settings)


def test_the_coupling_is_tried_in_proportion_to_the_labels():
    for n_patches in (150, 300):
        trained = train([draw_map(1, n_patches)], linear(SYMMETRIC))
        assert {strength.coupling / n_patches for strength in trained.scores} == set(COUPLING_SHARES)
        assert {strength.weights for strength in trained.scores} == set(STRENGTHS)


def test_a_given_strength_is_kept():
    trained = train([draw_map(1)], linear(SYMMETRIC, regularisation=7.0))
    assert trained.strength.weights == 7.0
    assert {strength.weights for strength in trained.scores} == {7.0}
    both = train([draw_map(1)], linear(SYMMETRIC, regularisation=7.0, coupling_regularisation=3.0))
    assert list(both.scores) == [Strength(7.0, 3.0)]
    assert list(train([draw_map(1)], linear(NONE, regularisation=2.0)).scores) == [Strength(2.0, 2.0)]


def test_labels_too_few_for_folds_still_train():
    one = draw_map(1)
    label = np.full(300, UNLABELLED, np.uint8)
    label[[np.flatnonzero(one.label == 1)[0], np.flatnonzero(one.label == 0)[0]]] = 1, 0
    trained = train([one._replace(label=label)], linear(SYMMETRIC))
    assert (trained.n_folds, trained.scores, trained.held_out) == (0, {}, None)
    assert (trained.strength, trained.model.calibration.slope) == (Strength(1.0, 30.0), 1.0)
    assert len(trained.model.operating) == 0
    given = train([one._replace(label=label)], linear(SYMMETRIC, regularisation=5.0))
    assert given.strength == Strength(5.0, 30.0)
    assert np.isfinite(trained.model.weights).all()


@pytest.mark.parametrize(
    ("label", "message"), [(UNLABELLED, "mapq label PATCHES"), (0, "are plausible"), (1, "are suspicious")]
)
def test_labels_that_cannot_train_are_refused(label, message):
    with pytest.raises(InputError, match=message):
        train([draw_map(1)._replace(label=np.full(300, label, np.uint8))], linear(SYMMETRIC))


def test_one_label_alone_and_no_map_at_all_are_refused():
    label = np.full(300, UNLABELLED, np.uint8)
    label[7] = 1
    with pytest.raises(InputError, match="all 1 labelled patches are suspicious"):
        train([draw_map(1)._replace(label=label)], linear(SYMMETRIC))
    with pytest.raises(InputError, match="no patch has a label"):
        train([], linear(SYMMETRIC))


@pytest.mark.parametrize(("edge_model", "last"), [(NONE, 0), (SYMMETRIC, 2)])
def test_no_coupling_may_be_negative(edge_model, last):
    one, settings = draw_map(1), linear(edge_model)
    problem = make_problem(prepare([one], settings), [one.label], settings, Strength(1.0, 1.0))
    n_weights = problem.design.shape[1]
    assert problem.bounded == tuple(range(n_weights - last, n_weights))


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_maps_without_pairs_and_empty_maps_train_along(edge_model):
    rng = np.random.default_rng(1)
    lone = draw_features(rng, 1, 0)._replace(node_names=("fit", "tilt", "thickness"))
    some = draw_features(rng, 30, 40)
    label = rng.integers(0, 2, 30).astype(np.uint8)
    maps = [
        TrainingMap(lone, np.ones(1, np.uint8), np.zeros(1, int)),
        TrainingMap(draw_features(rng, 0, 0), np.empty(0, np.uint8), np.empty(0, int)),
        TrainingMap(some, label, np.arange(30) // 5),
    ]
    trained = train(maps, linear(edge_model))
    assert np.isfinite(trained.model.weights).all()
    assert classify(some, trained.model).label.shape == (30,)


def test_pseudo_likelihood_is_highest_at_the_weights_found():
    maps = [draw_map(4, 60)]
    settings = linear(SYMMETRIC, class_weight="none")
    model = pseudo_model(maps, settings, 1e-6)
    best = slow_log_pseudo_likelihood(maps, model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        weights = model.weights + 0.05 * rng.normal(size=len(model.weights))
        weights[-2:] = np.maximum(weights[-2:], 0.0)
        other = Model(SYMMETRIC, {}, model.node, model.x_range, weights)
        assert slow_log_pseudo_likelihood(maps, other) < best


def test_the_scale_is_the_interquartile_range():
    found = fit_scaling(np.arange(9.0)[:, None] * [1.0, 10.0], ("a", "b"))
    np.testing.assert_allclose(found.median, [4.0, 40.0])
    np.testing.assert_allclose(found.scale, [4.0, 40.0])
    assert (found.names, found.clip) == (("a", "b"), CLIP)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_clip_spares_all_but_one_value_in_a_hundred_on_either_side(sign):
    values = np.zeros(201)
    values[-40:] = np.linspace(1.0, 40.0, 40)
    found = fit_scaling(sign * values[:, None], ("x",))
    assert found.median == 0.0
    np.testing.assert_allclose(found.scale, 38.0 / CLIP)


@pytest.mark.parametrize("noise", [0.0, 1e-12])
@pytest.mark.parametrize("value", [3.0, -3.0])
def test_a_column_that_is_constant_but_for_rounding_has_scale_one(value, noise):
    found = fit_scaling(value + noise * np.arange(5.0)[:, None], ("x",))
    assert found.scale == 1.0


def test_without_rows_nothing_is_changed_and_one_row_is_its_own_median():
    empty = fit_scaling(np.zeros((0, 2)), ("a", "b"))
    np.testing.assert_array_equal(empty.apply(np.array([[3.0, -2.0]])), [[3.0, -2.0]])
    one = fit_scaling(np.array([[7.0]]), ("a",))
    assert (one.median, one.scale) == (7.0, 1.0)


def test_the_range_ends_where_values_do_or_at_the_clip():
    assert fit_range(np.zeros(0)) == (0.0, 0.0)
    assert fit_range(np.arange(9.0)) == (0.0, 8.0)
    wild = np.concatenate([np.linspace(-2.0, 2.0, 999), [1e6, -1e6]])
    low, high = fit_range(wild)
    assert high == -low == pytest.approx(CLIP * 2.0, rel=0.01)
    np.testing.assert_allclose(fit_range(wild + 7.0), (low + 7.0, high + 7.0), rtol=1e-12)
