from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.labelling import compare_labels
from mapq.labelling.agreement import cohen_kappa
from mapq.patches import FROM_FIELD, FROM_HAND, UNLABELLED
from prf.shell.errors import InputError
from tests.mapq.labelled import draw_patches

NAMES = ("a", "b")


def labelled(label, source=FROM_HAND):
    patches = draw_patches(1)
    values = np.full(len(patches), UNLABELLED, np.uint8)
    values[: len(label)] = label
    sources = np.zeros(len(patches), np.uint8)
    sources[: len(label)] = source
    return replace(patches, label=values, label_source=sources)


def large_sample_error(table: np.ndarray) -> float:
    """Return the standard error of kappa of Fleiss, Cohen and Everitt (1969), equation 13, for many patches."""
    p = table / table.sum()
    rows, columns = p.sum(axis=1), p.sum(axis=0)
    chance, agreed = float(rows @ columns), float(np.trace(p))
    kappa = (agreed - chance) / (1.0 - chance)
    inside = sum(p[i, i] * (1.0 - (rows[i] + columns[i]) * (1.0 - kappa)) ** 2 for i in range(2))
    across = sum(p[i, 1 - i] * (columns[i] + rows[1 - i]) ** 2 for i in range(2))
    variance = inside + (1.0 - kappa) ** 2 * across - (kappa - chance * (1.0 - kappa)) ** 2
    return float(np.sqrt(variance / table.sum()) / (1.0 - chance))


def test_kappa_by_hand():
    kappa, (low, high) = cohen_kappa(np.array([[20, 5], [10, 15]]))
    assert kappa == pytest.approx(0.4)
    assert low < kappa < high


@pytest.mark.parametrize("table", [[[4000, 600], [300, 1100]], [[9000, 100], [500, 400]], [[900, 1100], [1200, 800]]])
def test_of_many_patches_the_interval_is_that_of_the_standard_error(table):
    counts = np.array(table)
    kappa, (low, high) = cohen_kappa(counts)
    wide = 1.96 * large_sample_error(counts)
    assert (low, high) == pytest.approx((kappa - wide, kappa + wide), abs=0.05 * wide)


def test_perfect_agreement_of_few_is_not_certain():
    kappa, (low, high) = cohen_kappa(np.array([[6, 0], [0, 4]]))
    assert (kappa, high) == (1.0, 1.0)
    assert 0.4 < low < 0.9
    more = cohen_kappa(np.array([[60, 0], [0, 40]]))[1][0]
    assert low < more < 1.0


def test_the_interval_does_not_ask_who_is_first_or_which_label_is_which():
    table = np.array([[12, 3], [7, 9]])
    expected = cohen_kappa(table)
    for other in (table.T, table[::-1, ::-1]):
        kappa, interval = cohen_kappa(other)
        assert kappa == pytest.approx(expected[0])
        assert interval == pytest.approx(expected[1], abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("kappa", "a", "b"), [(0.3, 0.4, 0.5), (0.7, 0.3, 0.35), (0.9, 0.5, 0.5)])
def test_intervals_cover_what_they_say(kappa, a, b):
    """Of 400 tables of 60 patches; false-alarm rate below 1e-4 where the true cover is 95 %: 90 to 99 % passes."""
    covariance = 0.5 * kappa * (a * (1 - b) + b * (1 - a))
    cells = [(1 - a) * (1 - b) + covariance, (1 - a) * b - covariance, a * (1 - b) - covariance, a * b + covariance]
    draws = np.random.default_rng(0).multinomial(60, cells, 400)
    intervals = np.array([cohen_kappa(draw.reshape(2, 2))[1] for draw in draws])
    covered = np.mean((intervals[:, 0] <= kappa) & (kappa <= intervals[:, 1]))
    assert 0.90 < covered < 0.99


def test_nothing_in_common_and_one_label_alone_have_no_kappa():
    for table in (np.zeros((2, 2), np.int64), np.array([[7, 0], [0, 0]])):
        assert np.isnan(cohen_kappa(table)[0])


def test_two_files():
    found = compare_labels(labelled([0, 0, 1, 1, 255, 0]), labelled([0, 1, 1, 0, 0]), NAMES)
    assert (found.n_patches, found.n_common, found.n_unsure) == (32, 4, (1, 0))
    assert found.confusion.tolist() == [[1, 1], [1, 1]]
    assert (found.agreement, found.kappa) == (0.5, 0.0)
    assert found.disagreeing.tolist() == [1, 3]
    rows = found.content()["disagreeing"]
    assert rows == [
        {"patch": 1, "first": "plausible", "second": "suspicious"},
        {"patch": 3, "first": "suspicious", "second": "plausible"},
    ]


def test_labels_by_hand_count_and_without_them_those_of_a_field():
    mixed = labelled([0, 0, 1], source=[FROM_HAND, FROM_FIELD, FROM_HAND])
    found = compare_labels(mixed, labelled([0, 1, 1], source=FROM_FIELD), NAMES)
    assert (found.n_common, found.by_hand) == (2, (True, False))


def test_other_patches_and_no_labels_are_refused():
    with pytest.raises(InputError, match="different patches"):
        compare_labels(labelled([0]), draw_patches(2, n_walls=12), NAMES)
    with pytest.raises(InputError, match="b: no patch has a label"):
        compare_labels(labelled([0]), labelled([]), NAMES)
