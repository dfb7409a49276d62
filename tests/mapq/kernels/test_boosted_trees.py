"""Sums of trees against a walk in plain Python, and against scikit-learn that grows them."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier

from mapq.crf.trees import RISING, Columns, grow
from mapq.kernels.boosted_trees import contributions
from tests.reference.mapq_trees import draw_potential, slow_contributions

NAMES = ("disagreement", "fit", "tilt", "colour")


def draw_rows(seed: int, n_rows: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (n, 4), a tenth of them unknown, and labels that go by the first column and by the third, not 0."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(n_rows, len(NAMES)))
    y = np.where(rows[:, 0] + np.abs(rows[:, 2]) + rng.normal(size=n_rows) > 1.0, 1.0, -1.0)
    rows[rng.random(rows.shape) < 0.1] = np.nan
    return rows, y


def columns(rows: np.ndarray) -> Columns:
    return Columns(NAMES, rows, np.full(rows.shape, -1))


def grown(rows: np.ndarray, y: np.ndarray):
    return grow([columns(rows)], [y], [np.ones(len(y))])


@pytest.mark.parametrize("seed", range(5))
def test_columns_add_what_a_walk_in_plain_python_adds(seed):
    rng = np.random.default_rng(seed)
    potential = draw_potential(rng, NAMES)
    rows = rng.normal(size=(40, 4))
    rows[rng.random(rows.shape) < 0.2] = np.nan
    rows[0, potential.trees.column[0]] = potential.trees.threshold[0]
    rows[1], rows[2] = np.inf, -np.inf
    expected = [slow_contributions(potential.trees, row) for row in rows.tolist()]
    np.testing.assert_allclose(contributions(potential.trees, rows), expected, atol=1e-12)


def test_no_rows_and_no_trees():
    potential = draw_potential(np.random.default_rng(0), NAMES)
    assert contributions(potential.trees, np.zeros((0, 4))).shape == (0, 5)
    none = draw_potential(np.random.default_rng(0), NAMES, 1).trees._replace(root=np.zeros(0, np.int64))
    np.testing.assert_array_equal(contributions(none, np.ones((3, 4))), np.zeros((3, 5)))


@pytest.mark.parametrize("seed", range(3))
def test_contributions_sum_to_predictions_of_scikit_learn(seed, monkeypatch):
    kept = []

    class Keeping(HistGradientBoostingClassifier):
        def fit(self, *args, **kwargs):
            kept.append(self)
            return super().fit(*args, **kwargs)

    monkeypatch.setattr("sklearn.ensemble.HistGradientBoostingClassifier", Keeping)
    potential = grown(*draw_rows(seed))
    rows = draw_rows(seed + 100)[0]
    np.testing.assert_allclose(potential.log_odds(columns(rows)), kept[0].decision_function(rows), atol=1e-9)


def test_columns_that_may_only_rise_or_fall_do():
    rows, y = draw_rows(1)
    potential = grown(rows, y)
    some = np.nan_to_num(draw_rows(2)[0][:50])
    for place, name in enumerate(NAMES):
        steps = []
        for value in np.linspace(-3.0, 3.0, 25):
            some[:, place] = value
            steps.append(potential.log_odds(columns(some)))
        slope = np.diff(steps, axis=0)
        if name in RISING:
            assert (RISING[name] * slope >= -1e-12).all(), name
        if name in ("disagreement", "tilt"):
            assert np.ptp(steps, axis=0).max() > 0.5, "and they count"
        if name == "tilt":
            assert slope.min() < -0.1 < 0.1 < slope.max(), "others go as they like"


def test_a_column_of_which_no_map_knows_anything_teaches_nothing():
    rows, y = draw_rows(3)
    rows[:, 1] = np.nan
    other = rows.copy()
    other[:, 1] = np.random.default_rng(0).normal(size=len(rows))
    potential = grown(rows, y)
    assert 1 not in potential.trees.column
    np.testing.assert_array_equal(potential.log_odds(columns(rows)), potential.log_odds(columns(other)))


def test_weights_and_labels_of_the_rows_count():
    rows, y = draw_rows(4)
    half = np.arange(len(y)) % 2 == 0
    by_label = grow([columns(rows)], [np.where(half, y, 0.0)], [np.ones(len(y))])
    alone = grown(rows[half], y[half])
    np.testing.assert_array_equal(by_label.log_odds(columns(rows)), alone.log_odds(columns(rows)))
    heavy = grow([columns(rows)], [y], [np.where(y > 0.0, 5.0, 1.0)])
    assert heavy.log_odds(columns(rows)).mean() > grown(rows, y).log_odds(columns(rows)).mean() + 0.5
