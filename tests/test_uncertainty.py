"""Intervals of shares of draws: coverage on chains whose law is known, stuck chains, ESS and R-hat beside arviz."""

from __future__ import annotations

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats

from prf.uncertainty import by_chain, effective_size, estimates, smallest_ess, split_rhat

N_CHAINS, N_DRAWS, N_SERIES = 4, 256, 2000


def markov(seed: int, share: float, time: float, n_chains: int = N_CHAINS, n: int = N_SERIES) -> np.ndarray:
    """Return stationary binary chains (n_chains, n_draws, n) that forget their state after `time` draws on average."""
    rng = np.random.default_rng(seed)
    fresh = rng.random((n_chains, N_DRAWS, n)) < share
    keeps = rng.random((n_chains, N_DRAWS, n)) < np.exp(-1.0 / time)
    for draw in range(1, N_DRAWS):
        fresh[:, draw] = np.where(keeps[:, draw], fresh[:, draw - 1], fresh[:, draw])
    return fresh


def two_levels(seed: int, share: float, time: float, n_chains: int = N_CHAINS, n: int = N_SERIES) -> np.ndarray:
    """Return chains that flicker at each draw round a level, which changes slowly: few switches, many colours."""
    level = np.where(markov(seed, 0.5, time, n_chains, n), 0.3 * share, 1.7 * share)
    return np.random.default_rng([seed, 1]).random(level.shape) < level


def coverage(black: np.ndarray, low: np.ndarray, high: np.ndarray, share: float) -> float:
    varies = (black != black[:1, :1]).any(axis=(0, 1))
    return float(((low <= share) & (share <= high))[varies].mean())


@pytest.mark.parametrize("law", [markov, two_levels])
@pytest.mark.parametrize("time", [0.5, 2.5, 8.0, 25.0])
@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_intervals_hold_as_often_as_promised(law, time: float, share: float) -> None:
    """Between 90 and 99.5 %: 2,000 series, coverages of 93 to 99 %, so a false alarm has p < 1e-3 in all of them."""
    black = law(1, share, time)
    found = estimates(black, 10.0)
    assert 0.90 < coverage(black, found.low, found.high, share) < 0.995


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_the_binomial_interval_of_all_draws_does_not(share: float) -> None:
    black = markov(1, share, 8.0)
    n, p = N_CHAINS * N_DRAWS, black.mean(axis=(0, 1))
    low, high = (stats.beta.ppf(level, n * p + 0.5, n * (1.0 - p) + 0.5) for level in (0.025, 0.975))
    assert coverage(black, low, high, share) < 0.6


def test_intervals_of_many_effective_draws_are_hardly_wider_than_needed() -> None:
    black = markov(2, 0.3, 0.5)
    found = estimates(black, 10.0)
    needed = 2.0 * 1.96 * np.sqrt(0.3 * 0.7 / (N_CHAINS * N_DRAWS) / np.tanh(1.0))
    assert needed < np.median(found.high - found.low) < 1.4 * needed


@pytest.mark.parametrize("n_chains", [1, 2])
def test_fewer_chains(n_chains: int) -> None:
    black = markov(3, 0.3, 2.5, n_chains)
    found = estimates(black, 10.0)
    assert 0.90 < coverage(black, found.low, found.high, 0.3) < 0.995


def test_draws_that_are_all_equal_follow_the_rule_of_three() -> None:
    black = np.zeros((4, 500, 2), np.bool_)
    black[:, :, 1] = True
    found = estimates(black, 30.0)
    assert found.low.tolist() == [0.0, found.low[1]]
    assert found.high.tolist() == [found.high[0], 1.0]
    assert 1.0 - found.low[1] == pytest.approx(found.high[0])
    assert (1.0 - found.high[0]) ** 30 == pytest.approx(0.05)
    assert found.high[0] == pytest.approx(3.0 / 30.0, rel=0.06)
    assert found.ess.tolist() == [30.0, 30.0]
    assert found.rhat.tolist() == [1.0, 1.0]


@pytest.mark.parametrize("n_black", [1, 2])
def test_stuck_chains_have_wide_intervals(n_black: int) -> None:
    black = np.zeros((4, 500, 1), np.bool_)
    black[:n_black] = True
    found = estimates(black, 1000.0)
    assert found.ess[0] < 5.0
    assert found.rhat[0] == np.inf
    assert found.low[0] == 0.0
    assert found.high[0] > 0.75


def test_a_colour_of_one_short_visit_may_have_no_probability() -> None:
    black = markov(8, 0.5, 1.0, n=2)
    black[:, :, 0] = False
    black[2, 100, 0] = True
    found = estimates(black, 10.0)
    assert found.low[0] == 0.0 < found.high[0] < 0.02
    assert 0.3 < found.low[1] < 0.5 < found.high[1] < 0.7


def test_too_few_draws_leave_everything_open() -> None:
    found = estimates(np.ones((4, 7, 3), np.bool_), 4.0)
    assert found.low.tolist() == [0.0] * 3
    assert found.high.tolist() == [1.0] * 3
    assert np.isnan(found.ess).all()


def test_batches_do_not_change_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    black = markov(4, 0.2, 10.0, n=50)
    whole = estimates(black, 10.0)
    monkeypatch.setattr("prf.uncertainty.MOST_VALUES", 3 * N_CHAINS * N_DRAWS)
    np.testing.assert_array_equal(estimates(black, 10.0), whole)
    assert estimates(black[:, :, :0], 10.0).low.shape == (0,)


@pytest.mark.parametrize("n_draws", [8, 9, 17, 136, 255])
@pytest.mark.parametrize("n_chains", [1, 2, 4])
def test_effective_size_and_rhat_agree_with_arviz(n_chains: int, n_draws: int) -> None:
    black = markov(5, 0.4, 3.0, n_chains, 40)[:, :n_draws]
    black = black[:, :, (black != black[:1, :1]).any(axis=(0, 1))]
    sizes, rhats = effective_size(black), split_rhat(black)
    for i in range(black.shape[2]):
        values = black[:, :, i].astype(np.float64)
        for method in ("mean", "bulk"):  # of a binary quantity ranks are the values
            expected = array_stats.ess(values, chain_axis=0, draw_axis=1, method=method)
            assert sizes[i] == pytest.approx(expected, rel=1e-6)
        if n_chains > 1 and np.isfinite(rhats[i]):
            expected = array_stats.rhat(values, chain_axis=0, draw_axis=1, method="split")
            assert rhats[i] == pytest.approx(expected, rel=1e-9)


def test_the_smallest_effective_size_is_that_of_colours_that_vary() -> None:
    colours = np.concatenate([markov(6, 0.3, 20.0, n=3), np.ones((4, N_DRAWS, 2), np.bool_)], axis=2)
    functionals = markov(7, 0.3, 60.0, n=1).astype(np.float64)
    assert smallest_ess(colours, functionals) == effective_size(colours)[:3].min()
    assert smallest_ess(colours[:, :, 3:], functionals) == max(effective_size(functionals)[0], 4.0)
    assert smallest_ess(colours[:, :, 3:], functionals * 0.0) == 4.0
    assert smallest_ess(colours[:, :7], functionals[:, :7]) == 4.0


def test_draws_are_sorted_by_chain_and_the_oldest_of_a_longer_one_left_out() -> None:
    chain = np.array([1, 0, 1, 0, 1], np.int32)
    np.testing.assert_array_equal(by_chain(np.arange(5), chain), [[1, 3], [2, 4]])
