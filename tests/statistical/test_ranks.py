"""The band of ranks: its level, and what it sees."""

from __future__ import annotations

import numpy as np
import pytest

from tests.statistical.ranks import counts_below, make_band, rank_of

SEED = 20261121


@pytest.mark.parametrize(("n", "n_draws"), [(200, 64), (100, 64), (30, 9)])
def test_uniform_ranks_leave_the_band_at_its_rate(n: int, n_draws: int) -> None:
    rng = np.random.default_rng(SEED)
    band = make_band(n, n_draws)
    verdicts = [band.judge(rng.integers(0, n_draws + 1, n)) for _ in range(2000)]
    # 20 expected; 5 and 38 are 3.4 and 4.0 standard deviations away.
    assert 5 < sum(verdict.outside > 0 for verdict in verdicts) < 38
    for verdict in verdicts:
        assert (verdict.p <= 0.01) == (verdict.outside > 0) or 0.008 < verdict.p < 0.012


def test_p_is_uniform_where_ranks_are() -> None:
    rng = np.random.default_rng(SEED)
    band = make_band(200, 64)
    p = np.array([band.judge(rng.integers(0, 65, 200)).p for _ in range(1000)])
    assert 0.45 < np.median(p) < 0.56
    assert 0.07 < (p < 0.1).mean() < 0.13


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("a bias of half a standard deviation", lambda rng, x: x + 0.5),
        ("draws too narrow by a third", lambda rng, x: x / 0.66),
        ("draws too wide by a half", lambda rng, x: x / 1.6),
    ],
)
def test_wrong_posteriors_leave_it(name: str, spoil: object) -> None:
    rng = np.random.default_rng(SEED)
    truth = spoil(rng, rng.normal(size=200))  # type: ignore[operator]
    ranks = [rank_of(np.array([x]), rng.normal(size=(64, 1)), rng)[0] for x in truth]
    assert make_band(200, 64).judge(ranks).outside > 0, name


def test_ranks_of_equal_values_are_uniform() -> None:
    rng = np.random.default_rng(SEED)
    ranks = np.array([rank_of(np.zeros(3), np.zeros((9, 3)), rng) for _ in range(3000)])
    assert np.bincount(ranks.ravel(), minlength=10).min() > 780
    assert ranks.max() == 9


def test_ranks_without_ties_are_counts() -> None:
    rng = np.random.default_rng(SEED)
    draws = rng.normal(size=(7, 2))
    truth = np.array([0.1, -3.0])
    assert rank_of(truth, draws, rng).tolist() == (draws < truth).sum(axis=0).tolist()


def test_counts_are_those_of_a_loop() -> None:
    ranks = np.array([[0, 3, 3, 1], [2, 2, 0, 3]])
    expected = [[sum(rank < k for rank in row) for k in (1, 2, 3)] for row in ranks.tolist()]
    assert counts_below(ranks, 3).tolist() == expected
