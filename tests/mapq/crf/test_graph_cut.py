from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.energy import Field
from mapq.crf.graph_cut import solve
from mapq.labels import SUSPICIOUS
from prf.shell.errors import InputError
from tests.reference.mapq_crf import best_labellings, draw_pairs, enumerate_field, slow_differences, tree_differences

NO_PAIRS = np.empty((0, 2), np.int64)


def draw_field(seed: int, n_most: int = 16) -> Field:
    """Return a random field; every second one of small whole numbers, which tie often."""
    rng = np.random.default_rng(seed)
    n_patches = int(rng.integers(1, n_most + 1))
    pairs = draw_pairs(rng, n_patches, int(rng.integers(0, 2 * n_patches + 1))).astype(np.int64)
    if seed % 2:
        whole = rng.integers(-2, 3, n_patches).astype(float), rng.integers(0, 3, len(pairs)).astype(float)
        return Field(whole[0], pairs, whole[1])
    return Field(rng.normal(size=n_patches), pairs, rng.exponential(rng.choice([0.1, 0.5, 2.0]), len(pairs)))


def as_signs(label: np.ndarray) -> np.ndarray:
    return np.where(label == SUSPICIOUS, 1.0, -1.0)


@pytest.mark.parametrize("start", range(0, 400, 50))
def test_the_cut_is_the_best_of_all_labellings_ties_to_suspicious(start):
    for seed in range(start, start + 50):
        field = draw_field(seed, 12 if seed % 10 else 16)
        y = as_signs(solve(field).label)
        scores, _ = enumerate_field(field)
        assert field.score(y) == pytest.approx(scores.max(), abs=1e-9), seed
        np.testing.assert_array_equal(y, best_labellings(field).max(axis=0), err_msg=str(seed))


@pytest.mark.parametrize("start", range(0, 400, 50))
def test_differences_are_those_of_all_labellings(start):
    for seed in range(start, start + 50):
        field = draw_field(seed, 12)
        cut = solve(field)
        np.testing.assert_allclose(cut.difference, slow_differences(field), atol=1e-9, err_msg=str(seed))
        np.testing.assert_array_equal(cut.difference >= 0.0, cut.label == SUSPICIOUS)


def test_differences_are_those_of_fresh_cuts_on_a_large_graph():
    rng = np.random.default_rng(5)
    pairs = draw_pairs(rng, 2000, 5000).astype(np.int64)
    field = Field(rng.normal(size=2000), pairs, rng.exponential(0.4, len(pairs)))
    cut = solve(field)
    best = field.score(as_signs(cut.label))
    for patch in rng.choice(2000, 40, replace=False):
        forced = field.theta.copy()
        forced[patch] -= 1e4 * as_signs(cut.label)[patch]
        y = as_signs(solve(field._replace(theta=forced), np.zeros(2000, np.bool_)).label)
        assert y[patch] == -as_signs(cut.label)[patch]
        assert abs(cut.difference[patch]) == pytest.approx(best - field.score(y), abs=1e-6)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))])
def test_the_cut_of_a_large_graph_is_that_of_another_solver(seed):
    thinqpbo = pytest.importorskip("thinqpbo")
    rng = np.random.default_rng(seed)
    n_patches = 3000
    pairs = draw_pairs(rng, n_patches, 9000).astype(np.int64)
    field = Field(rng.normal(size=n_patches), pairs, rng.exponential(rng.choice([0.1, 0.4, 1.0]), len(pairs)))
    other = thinqpbo.QPBODouble()
    other.add_node(n_patches)
    for i, theta in enumerate(field.theta):
        other.add_unary_term(i, theta, -theta)
    for (i, j), coupling in zip(field.pairs.tolist(), field.coupling, strict=True):
        other.add_pairwise_term(i, j, -coupling, coupling, coupling, -coupling)
    other.solve()
    other.compute_weak_persistencies()
    theirs = np.array([other.get_label(i) for i in range(n_patches)])
    assert (theirs >= 0).all(), "a submodular field leaves no patch unlabelled"
    np.testing.assert_array_equal(solve(field).label, theirs)


@pytest.mark.parametrize("seed", range(6))
def test_differences_on_a_tree_are_those_of_messages(seed):
    rng = np.random.default_rng(seed)
    n_patches = 1500
    parents = np.array([rng.integers(0, i) for i in range(1, n_patches)])
    pairs = np.column_stack([parents, np.arange(1, n_patches)])
    field = Field(rng.normal(size=n_patches), pairs, rng.exponential(0.6, n_patches - 1))
    np.testing.assert_allclose(solve(field).difference, tree_differences(field), atol=1e-8)


def test_only_wanted_differences_are_computed_and_they_are_the_same():
    field = draw_field(300)
    wanted = np.arange(len(field.theta)) % 3 == 0
    every, some = solve(field), solve(field, wanted)
    np.testing.assert_array_equal(every.label, some.label)
    np.testing.assert_array_equal(some.difference, np.where(wanted, every.difference, np.nan))


@pytest.mark.parametrize("seed", range(20))
def test_the_order_of_patches_and_pairs_changes_nothing(seed):
    field = draw_field(seed)
    rng = np.random.default_rng(seed)
    order, edge_order = rng.permutation(len(field.theta)), rng.permutation(len(field.pairs))
    place = np.argsort(order)
    shuffled = Field(field.theta[order], place[field.pairs][edge_order][:, ::-1], field.coupling[edge_order])
    cut, again = solve(field), solve(shuffled)
    np.testing.assert_array_equal(cut.label[order], again.label)
    np.testing.assert_array_equal(cut.difference[order], again.difference)


def test_without_coupling_a_patch_has_its_own_sign():
    theta = np.array([0.5, -0.25, 0.0])
    cut = solve(Field(theta, np.array([[0, 1]]), np.zeros(1)))
    np.testing.assert_array_equal(cut.label, [1, 0, 1])
    np.testing.assert_array_equal(cut.difference, [1.0, -0.5, 0.0])


@pytest.mark.parametrize(
    ("theta", "coupling", "unit"),
    [
        ([1.0, 1.0], 0.25, 2.0**-40),
        ([2.0**70, 2.0], 0.0, 2.0**12),
        ([3.0 * 2.0**40, 0.0], 0.0, 2.0**-16),
        ([3.0 * 2.0**38, -3.0 * 2.0**38], 0.0, 2.0**-17),
        ([2.0**40, 0.0], 2.0**41, 2.0**-16),
        ([2.0**42 - 2.25, 0.0], 0.0, 2.0**-15),
        ([2.0**42 - 2.75, 0.0], 0.0, 2.0**-16),
    ],
)
def test_energies_are_rounded_to_a_fine_unit_or_to_what_the_flow_has_room_for(theta, coupling, unit):
    """2**59 units hold twice the sum of all energies, and one unit of 1 for each: four patches and a pair."""
    field = Field(np.array([*theta, -0.4 * unit, -0.6 * unit]), np.array([[0, 1]]), np.array([coupling]))
    cut = solve(field)
    np.testing.assert_array_equal(cut.label[2:], [1, 0])
    np.testing.assert_array_equal(cut.difference[2:], [0.0, -2.0 * unit])


def test_huge_energies_do_not_overflow():
    field = Field(np.array([1e300, -1e300, 1.0]), np.array([[0, 1], [1, 2]]), np.array([1e299, 1e300]))
    cut = solve(field)
    assert cut.label.tolist() == [1, 0, 0]
    assert cut.difference[0] == pytest.approx(2e300 - 2e299)


def test_a_negative_coupling_is_refused_before_the_cut():
    with pytest.raises(InputError, match=r"patches 1 and 2 is -0\.1"):
        solve(Field(np.zeros(3), np.array([[0, 1], [1, 2]]), np.array([0.5, -0.1])))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_are_refused(bad):
    with pytest.raises(InputError, match="not finite"):
        solve(Field(np.array([0.0, bad]), NO_PAIRS, np.empty(0)))
