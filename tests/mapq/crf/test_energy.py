from __future__ import annotations

import itertools

import numpy as np
import pytest

from mapq.crf import classify, explain
from mapq.crf.energy import label_design, make_field, model_inputs, unary_design
from mapq.crf.explain import BASE, NEIGHBOUR_LABEL
from mapq.crf.trees import LOW_RATIO, columns_of
from mapq.features.pairs import EDGE_NAMES
from mapq.model import EDGE_MODELS, SYMMETRIC
from prf.shell.errors import InputError
from tests.mapq.crf.test_trees import draw as scanned
from tests.reference.mapq_crf import draw_features, draw_model, local_log_odds, slow_score
from tests.reference.mapq_trees import draw_potential

CASES = list(itertools.product(EDGE_MODELS, ("trees", "linear"), range(5)))


def draw(edge_model, seed, n_patches=7, n_pairs=12, potential="linear"):
    """Return features and a model; the trees of one see unknown values, and ask for pairs too."""
    rng = np.random.default_rng(seed)
    if potential == "linear":
        return draw_features(rng, n_patches, n_pairs), draw_model(rng, edge_model)
    features = draw_features(rng, n_patches, n_pairs, EDGE_NAMES)
    features.node[::3, 1] = np.nan
    return features, draw_model(rng, edge_model, potential=draw_potential(rng, columns_of(features).names))


def as_labels(y):
    return ((np.array(y) + 1) // 2).astype(np.uint8)


@pytest.mark.parametrize(("edge_model", "potential", "seed"), CASES)
def test_the_field_scores_as_the_definition(edge_model, potential, seed):
    features, model = draw(edge_model, seed, potential=potential)
    field = make_field(model_inputs(features, model), edge_model, model.weights)
    for y in itertools.product([-1, 1], repeat=7):
        assert field.score(np.array(y, float)) == pytest.approx(slow_score(features, model, list(y)), abs=1e-9)


@pytest.mark.parametrize(("edge_model", "potential", "seed"), CASES)
def test_the_columns_of_the_labels_give_each_patch_its_score_given_the_others(edge_model, potential, seed):
    features, model = draw(edge_model, seed, potential=potential)
    y = np.random.default_rng(seed).choice([-1.0, 1.0], 7)
    inputs = model_inputs(features, model)
    design = np.hstack([unary_design(inputs), label_design(inputs, edge_model, y)])
    for patch, half in enumerate(design @ model.weights):
        up, down = np.where(np.arange(7) == patch, 1.0, y), np.where(np.arange(7) == patch, -1.0, y)
        expected = slow_score(features, model, up.tolist()) - slow_score(features, model, down.tolist())
        assert 2.0 * half == pytest.approx(expected, abs=1e-9)


def test_a_neighbour_without_a_label_has_no_effect():
    features, model = draw(SYMMETRIC, 6)
    inputs = model_inputs(features, model)
    y = np.zeros(7)
    np.testing.assert_array_equal(label_design(inputs, SYMMETRIC, y), np.zeros((7, 2)))
    y[2] = 1.0
    touched = np.unique(features.pairs[(features.pairs == 2).any(axis=1)])
    np.testing.assert_array_equal(
        np.flatnonzero(label_design(inputs, SYMMETRIC, y).any(axis=1)), np.setdiff1d(touched, 2)
    )


@pytest.mark.parametrize(("edge_model", "potential", "seed"), CASES)
def test_the_labelling_is_the_best_by_the_definition(edge_model, potential, seed):
    features, model = draw(edge_model, seed, potential=potential)
    labelling = classify(features, model)
    best = max(itertools.product([-1, 1], repeat=7), key=lambda y: slow_score(features, model, list(y)))
    np.testing.assert_array_equal(labelling.label, as_labels(best))
    np.testing.assert_array_equal(labelling.probability > 0.5, labelling.label == 1)
    np.testing.assert_allclose(labelling.probability, 1.0 / (1.0 + np.exp(-0.7 * labelling.difference)), atol=1e-6)


@pytest.mark.parametrize(("edge_model", "potential", "seed"), CASES)
def test_terms_sum_to_the_log_odds_given_the_neighbours(edge_model, potential, seed):
    features, model = draw(edge_model, seed, potential=potential)
    label = np.random.default_rng(seed).integers(0, 2, 7).astype(np.uint8)
    terms = explain(features, model, label)
    sums = np.bincount(terms.patch, terms.contribution, 7)
    np.testing.assert_allclose(sums, local_log_odds(features, model, label), atol=1e-12)
    for patch in range(7):
        y = (2 * label.astype(int) - 1).tolist()
        up, down = [*y[:patch], 1, *y[patch + 1 :]], [*y[:patch], -1, *y[patch + 1 :]]
        expected = slow_score(features, model, up) - slow_score(features, model, down)
        assert sums[patch] == pytest.approx(expected, abs=1e-9)


def test_terms_of_patches_that_their_bounds_decide_sum_up_too():
    features = scanned(1)
    model = draw_model(
        np.random.default_rng(1), potential=draw_potential(np.random.default_rng(2), columns_of(features).names)
    )
    label = np.random.default_rng(3).integers(0, 2, len(features.node)).astype(np.uint8)
    for tolerance in (0.1, 0.3):
        decided = features.disagreement[:, 0] > tolerance
        assert decided.any()
        terms = explain(features, model, label, tolerance)
        assert {int(patch) for patch in np.flatnonzero(decided)} <= set(
            terms.patch[terms.name == terms.names.index(LOW_RATIO)].tolist()
        )
        field = make_field(model_inputs(features, model, tolerance), SYMMETRIC, model.weights)
        y = np.where(label == 1, 1.0, -1.0)
        expected = 2.0 * field.theta
        np.add.at(expected, field.pairs, 2.0 * field.coupling[:, None] * y[field.pairs[:, ::-1]])
        np.testing.assert_allclose(np.bincount(terms.patch, terms.contribution), expected, atol=1e-12)


def test_terms_come_largest_first_with_values_in_their_own_unit():
    features, model = draw(SYMMETRIC, 3)
    label = np.array([1, 0, 1, 0, 1, 0, 1], np.uint8)
    terms = explain(features, model, label)
    starts = terms.starts(7)
    assert (starts[0], starts[-1]) == (0, len(terms.patch))
    for begin, end in itertools.pairwise(starts):
        assert (np.diff(np.abs(terms.contribution[begin:end])) <= 0).all()
    for patch, name, value, other in zip(terms.patch, terms.name, terms.value, terms.other, strict=True):
        match terms.names[name]:
            case "base":
                assert (value, other) == (1.0, -1)
            case "neighbour label":
                assert value == label[other]
            case ("fit" | "tilt" | "thickness") as feature:
                assert (value, other) == (features.node[patch, features.node_names.index(feature)], -1)
    assert set(terms.names) == {BASE, NEIGHBOUR_LABEL, *features.node_names}


def test_the_symmetric_model_turns_round_with_its_nodes():
    features, model = draw(SYMMETRIC, 8)
    weights = model.weights.copy()
    weights[:-2] *= -1
    turned = type(model)(SYMMETRIC, {}, model.node, model.x_range, weights)
    labels = classify(features, model).label, classify(features, turned).label
    np.testing.assert_array_equal(labels[0], 1 - labels[1])


def test_coupling_stays_non_negative_far_outside_the_range_seen():
    features, model = draw(SYMMETRIC, 4)
    wild = features._replace(plausibility=np.linspace(-1e6, 1e6, len(features.pairs)))
    field = make_field(model_inputs(wild, model), SYMMETRIC, model.weights)
    assert (field.coupling >= 0.0).all()


def test_features_that_lack_a_name_or_a_number_are_refused():
    features, model = draw(SYMMETRIC, 2)
    with pytest.raises(InputError, match="expected a node feature fit; these features have a, b, c"):
        classify(features._replace(node_names=("a", "b", "c")), model)
    features.node[3, 1] = np.inf
    with pytest.raises(InputError, match="feature tilt is infinite in 1 of 7 places"):
        classify(features, model)


def test_what_is_not_known_lies_in_the_middle():
    features, model = draw(SYMMETRIC, 2)
    features.node[3, 1] = np.nan
    inputs = model_inputs(features, model)
    assert inputs.node[3, 1] == 0.0
    features.node[3, 1] = model.node.median[1]
    np.testing.assert_array_equal(inputs.node, model_inputs(features, model).node)
