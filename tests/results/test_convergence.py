"""R-hat and ESS beside arviz, the verdict, and how much longer a run is said to need."""

from __future__ import annotations

import math

import numpy as np
import pytest
from arviz_stats.base import array_stats

from prf.results.convergence import (
    Diagnosis,
    diagnose,
    disagree,
    effective_size,
    is_early,
    outlook,
    range_words,
    rounded,
    split_rhat,
    verdict,
    worst_rhat,
)
from prf.results.run import Agreement, agreement


def chains(seed: int = 1, n_chains: int = 4, n_draws: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n_chains, n_draws))


def one(values: np.ndarray) -> tuple[float, float, str]:
    found = diagnose({"f": values})["f"]
    return found.rhat, found.ess, found.state


@pytest.mark.parametrize("n_draws", [8, 9, 17, 136, 255])
@pytest.mark.parametrize("n_chains", [1, 2, 4])
def test_rank_normalised_rhat_and_bulk_ess_agree_with_arviz(n_chains: int, n_draws: int) -> None:
    """Of slow, skew chains, with and without ties; one chain is compared with itself."""
    slow = np.exp(np.cumsum(chains(5, n_chains, n_draws), axis=1) / 4.0)
    for values in (slow, np.round(slow, 1), chains(6, n_chains, n_draws)):
        rhat, ess, _ = one(values)
        half = n_draws // 2
        several = values if n_chains > 1 else np.vstack((values[:, :half], values[:, -half:]))
        if n_draws >= 16 or n_chains > 1:
            expected = array_stats.rhat(several, chain_axis=0, draw_axis=1, method="rank")
            assert rhat == pytest.approx(expected, rel=1e-9)
        assert ess == pytest.approx(array_stats.ess(values, chain_axis=0, draw_axis=1, method="bulk"), rel=1e-6)


@pytest.mark.parametrize("n_draws", [8, 9, 17, 136, 255])
@pytest.mark.parametrize("n_chains", [1, 2, 4])
def test_many_binary_quantities_at_once_agree_with_arviz(n_chains: int, n_draws: int) -> None:
    black = np.cumsum(np.random.default_rng(5).random((n_chains, n_draws, 40)) < 0.2, axis=1) % 2 == 0
    sizes, rhats = effective_size(black), split_rhat(black)
    for i in np.flatnonzero(np.isfinite(sizes)):
        values = black[:, :, i].astype(np.float64)
        for method in ("mean", "bulk"):  # of a binary quantity ranks are the values
            expected = array_stats.ess(values, chain_axis=0, draw_axis=1, method=method)
            assert sizes[i] == pytest.approx(expected, rel=1e-6)
        if n_chains > 1 and np.isfinite(rhats[i]):
            expected = array_stats.rhat(values, chain_axis=0, draw_axis=1, method="split")
            assert rhats[i] == pytest.approx(expected, rel=1e-9)


def test_independent_draws_agree() -> None:
    rhat, ess, state = one(chains())
    assert state == "varies"
    assert rhat == pytest.approx(1.0, abs=0.01)
    assert 1200 < ess < 2200
    assert verdict(diagnose({"f": chains()})).converged


def test_a_shifted_chain_and_one_of_another_spread_are_found() -> None:
    shifted, wide = chains(), chains()
    shifted[2] += 1.0
    wide[2] *= 10.0
    found = verdict(diagnose({"good": chains(2), "shifted": shifted}))
    assert (found.converged, found.worst) == (False, "shifted")
    assert "R-hat" in found.reason
    assert one(wide)[0] > 1.05


def test_too_few_effective_draws_are_named() -> None:
    slow = np.cumsum(chains(3, 4, 400), axis=1)
    found = verdict(diagnose({"fast": chains(), "slow": slow}))
    assert (found.converged, found.worst) == (False, "slow")


def test_a_constant_agrees_and_is_called_so() -> None:
    found = diagnose({"probe": np.ones((4, 100), dtype=bool)})
    assert math.isnan(found["probe"].rhat)
    assert found["probe"].describe() == "constant"
    assert verdict(found).converged


def test_chains_stuck_at_different_values_never_agree() -> None:
    stuck = np.repeat([[1.0], [1.0], [0.0], [1.0]], 100, axis=1)
    step_in_the_middle = np.repeat([[0.0, 1.0]], 50, axis=1).repeat(4, axis=0)
    assert one(stuck) == one(step_in_the_middle) == (math.inf, 0.0, "stuck")
    found = verdict(diagnose({"probe": stuck, "good": chains()}))
    assert (found.converged, found.worst) == (False, "probe")
    assert "different values" in found.reason


def test_a_fair_coin_agrees_although_its_folded_half_is_constant() -> None:
    coin = np.random.default_rng(5).permuted(np.tile([0.0, 1.0], (4, 200)), axis=1)
    rhat, _, state = one(coin)
    assert state == "varies"
    assert rhat < 1.05


def test_one_chain_is_compared_with_itself() -> None:
    assert one(chains(1, 1))[0] < 1.05
    assert one(np.linspace(0.0, 1.0, 400)[None, :])[0] > 1.5


@pytest.mark.parametrize("n_draws", [0, 1, 7])
def test_short_chains_do_not_agree(n_draws: int) -> None:
    found = diagnose({"f": chains(1, 4, n_draws)})
    assert found["f"].state == "short"
    assert not verdict(found).converged
    assert not verdict({}).converged


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_values_that_are_not_finite_do_not_agree(bad: float) -> None:
    values = chains()
    values[1, 7] = bad
    assert one(values) == (math.inf, 0.0, "not finite")


def test_long_chains_are_thinned_so_that_the_cost_is_bounded() -> None:
    assert one(chains(1, 4, 100_000))[1] < 2400  # of 2,000 draws that are looked at


def test_unseen_functionals_have_a_looser_rule_and_are_last() -> None:
    slow = chains() + np.array([[0.0], [0.5], [1.0], [0.0]])
    assert 1.05 < one(slow)[0] < 1.2
    found = diagnose({"far": slow, "near": chains(2)}, unseen=["far"])
    assert [each.seen for each in found.values()] == [False, True]
    assert verdict(found).converged
    assert not verdict(diagnose({"far": slow, "near": chains(2)})).converged
    apart = chains() + 10.0 * np.arange(4)[:, None]
    judged = verdict(diagnose({"far": apart, "near": chains(2)}, unseen=["far"]))
    assert (judged.converged, judged.seen, judged.worst) == (False, True, "far")
    assert judged.reason.endswith("on unseen ground")
    judged = verdict(diagnose({"far": apart, "near": slow}, unseen=["far"]))
    assert (judged.converged, judged.seen, judged.worst) == (False, False, "near")


def diagnoses(*values: float) -> list[Diagnosis]:
    return [Diagnosis(rhat, 200.0, "stuck" if math.isinf(rhat) else "varies") for rhat in values]


def test_the_worst_counts() -> None:
    assert worst_rhat(diagnoses(1.01, 1.4, math.nan)) == 1.4
    assert worst_rhat(diagnoses(1.01, math.inf)) == math.inf
    assert worst_rhat(diagnoses(math.nan)) == worst_rhat([]) == 1.0


@pytest.mark.parametrize(
    ("before", "now", "expected"),
    [
        (1.9, 1.9, True),
        (1.5, 2.5, True),
        (1.0, 1.2, True),
        (1.9, 1.46, False),
        (3.0, 1.2, False),
        (1.04, 1.04, False),
        (math.inf, math.inf, True),
        (1.2, math.inf, True),
        (math.inf, 1.9, False),
    ],
)
def test_chains_disagree_that_do_not_come_nearer(before: float, now: float, expected: bool) -> None:
    assert disagree(diagnoses(1.0, before), diagnoses(now, 1.0)) is expected
    unseen = [each._replace(seen=False) for each in diagnoses(now)]
    assert not disagree(diagnoses(1.0), [*unseen, *diagnoses(1.0)])


def pair(half: Diagnosis, now: Diagnosis, climbs: bool = False) -> tuple[str, tuple[float, float] | None]:
    return outlook({"f": half}, {"f": now}, 100.0, climbs)


def test_chains_that_agree_need_nothing() -> None:
    assert pair(Diagnosis(1.1, 60.0, "varies"), Diagnosis(1.01, 400.0, "varies")) == ("agree", None)


def test_ess_grows_with_the_steps() -> None:
    """A quarter of the draws that it takes: three times as long again."""
    assert pair(Diagnosis(1.04, 12.0, "varies"), Diagnosis(1.02, 25.0, "varies")) == ("nearing", (300.0, 300.0))


def test_rhat_falls_in_inverse_proportion() -> None:
    """Twice as far from 1 as it may be: as long again."""
    assert pair(Diagnosis(1.2, 60.0, "varies"), Diagnosis(1.1, 120.0, "varies")) == ("nearing", (100.0, 100.0))


def test_rhat_that_falls_more_slowly_may_go_on_so() -> None:
    """At 0.7 times as far from 1 after twice the steps, half as far takes 2 ** 1.94 times the steps."""
    assert pair(Diagnosis(1.0 + 0.1 / 0.7, 60.0, "varies"), Diagnosis(1.1, 120.0, "varies")) == (
        "nearing",
        (100.0, 300.0),
    )


def test_a_time_that_is_hardly_known_is_not_said() -> None:
    assert pair(Diagnosis(2.0, 60.0, "varies"), Diagnosis(1.7, 80.0, "varies")) == ("nearing", None)


def test_what_was_not_seen_has_a_bound_of_its_own() -> None:
    half, now = Diagnosis(1.8, 4.0, "varies", seen=False), Diagnosis(1.4, 8.0, "varies", seen=False)
    assert pair(half, now) == ("nearing", (100.0, 100.0))
    assert pair(half, half) == ("flat", None)


@pytest.mark.parametrize("now", [Diagnosis(1.19, 12.0, "varies"), Diagnosis(math.inf, 0.0, "stuck")])
def test_where_rhat_stays_more_time_is_no_help(now: Diagnosis) -> None:
    assert pair(Diagnosis(1.2, 10.0, "varies"), now) == ("flat", None)


def test_chains_that_climb_may_yet_come_nearer() -> None:
    assert pair(Diagnosis(1.2, 10.0, "varies"), Diagnosis(1.19, 12.0, "varies"), climbs=True)[0] == "unknown"


def test_of_few_draws_nothing_is_known() -> None:
    short = Diagnosis(math.nan, math.nan, "short")
    assert pair(short, Diagnosis(1.5, 10.0, "varies")) == pair(short, short) == ("unknown", None)


def test_a_range_is_said_with_both_ends() -> None:
    assert range_words(600.0, 600.0) == "about 10 minutes"
    assert range_words(1200.0, 3600.0) == "20 minutes to 1 hour"
    assert range_words(60.0, 180.0) == "1 to 3 minutes"


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1.0, 10.0), (31.0, 40.0), (130.0, 150.0), (700.0, 900.0), (4000.0, 7200.0), (60 * 3600.0, 3 * 86400.0)],
)
def test_times_are_rounded_up_to_what_people_say(seconds: float, said: float) -> None:
    assert rounded(seconds) == said


# Where chains agree: shares of the ground, places, and how both are reported.


ORIGIN = np.array([10.0, 20.0])


def example() -> Agreement:
    """Two places on seen ground, one of them of cells that touch at a corner only, and one place that nobody saw."""
    differs = np.zeros((10, 10), np.float32)
    differs[0:2, 0:3] = 0.5
    differs[1, 1] = 0.9
    differs[5, 5] = differs[6, 6] = 0.3
    differs[9, 5:] = 1.0
    differs[8, 0] = np.nan
    seen = np.ones((10, 10), np.bool_)
    seen[8:] = False
    return agreement(differs, seen, ORIGIN, 0.5)


def test_shares_are_of_the_cells_that_were_seen_and_of_the_rest() -> None:
    found = example()
    assert found.seen == 1.0 - 8 / 80
    assert found.unseen == 1.0 - 5 / 19


def test_places_are_connected_seen_cells_the_largest_first() -> None:
    (x, y, area, difference), *others = example().places
    assert (x, y) in {(10.75, 20.25), (10.75, 20.75)}
    assert area == 6 * 0.25
    assert difference == np.float32(0.9)
    assert [place[:3] for place in others] == [(12.75, 22.75, 0.25), (13.25, 23.25, 0.25)]


def test_a_small_difference_is_none() -> None:
    found = agreement(np.full((3, 3), 0.2, np.float32), np.ones((3, 3), np.bool_), ORIGIN, 1.0)
    assert (found.seen, found.places) == (1.0, [])
    assert found.words() == "chains agree on 100 % of the seen ground"
    assert math.isnan(found.unseen)


@pytest.mark.parametrize(
    ("rhat", "state", "draws_per_chain", "expected"),
    [
        (3.33, "varies", 12, True),
        (1.5, "varies", 24, True),
        (2.6, "varies", 100, True),
        (None, "stuck", 100, True),
        (2.1, "varies", 454, False),
        (None, "constant", 25, False),
    ],
)
def test_a_run_that_has_hardly_begun_is_early(
    rhat: float | None, state: str, draws_per_chain: int, expected: bool
) -> None:
    """Of the runs in question the first had drawn 48 maps in 40,000 steps, on whose cells its chains mostly agreed."""
    assert is_early({"log_likelihood": {"rhat": rhat, "state": state}}, draws_per_chain) == expected
    assert is_early({}, draws_per_chain) == (draws_per_chain < 25)


def test_one_chain_has_nothing_to_compare() -> None:
    found = agreement(np.full((3, 3), np.nan, np.float32), np.ones((3, 3), np.bool_), ORIGIN, 1.0)
    assert found.words() == ""
    assert found.document() == {"seen": None, "unseen": None, "places": []}
    assert Agreement.of_document(found.document()).words() == ""


def test_words_round_down_and_name_the_places() -> None:
    found = example()._replace(seen=0.9999)
    assert found.words().startswith("chains agree on 99 % of the seen ground; they differ most round (10.8, 20.")
    assert found.words().endswith("(12.8, 22.8), (13.2, 23.2)")
    again = Agreement.of_document(found.document())
    assert again.words() == found.words()
