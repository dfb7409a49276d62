"""How much longer a run is said to need."""

from __future__ import annotations

import math

import pytest

from prf.diagnostics import Diagnosis
from prf.sampler.convergence import Outlook, outlook, rounded


def pair(half: Diagnosis, now: Diagnosis, climbs: bool = False) -> Outlook:
    return outlook({"f": half}, {"f": now}, 100.0, climbs)


def test_chains_that_agree_need_nothing() -> None:
    assert pair(Diagnosis(1.1, 60.0, "varies"), Diagnosis(1.01, 400.0, "varies")) == Outlook("agree", None)


def test_ess_grows_with_the_steps() -> None:
    """A quarter of the draws that it takes: three times as long again."""
    assert pair(Diagnosis(1.04, 12.0, "varies"), Diagnosis(1.02, 25.0, "varies")) == Outlook("nearing", 300.0)


def test_rhat_falls_in_inverse_proportion() -> None:
    """Twice as far from 1 as it may be: as long again."""
    assert pair(Diagnosis(1.2, 60.0, "varies"), Diagnosis(1.1, 120.0, "varies")) == Outlook("nearing", 100.0)


def test_what_was_not_seen_has_a_bound_of_its_own() -> None:
    half, now = Diagnosis(1.8, 4.0, "varies", seen=False), Diagnosis(1.4, 8.0, "varies", seen=False)
    assert pair(half, now) == Outlook("nearing", 100.0)
    assert pair(half, half) == Outlook("flat", None)


@pytest.mark.parametrize("now", [Diagnosis(1.19, 12.0, "varies"), Diagnosis(math.inf, 0.0, "stuck")])
def test_where_rhat_stays_more_time_is_no_help(now: Diagnosis) -> None:
    assert pair(Diagnosis(1.2, 10.0, "varies"), now) == Outlook("flat", None)


def test_chains_that_climb_may_yet_come_nearer() -> None:
    assert pair(Diagnosis(1.2, 10.0, "varies"), Diagnosis(1.19, 12.0, "varies"), climbs=True).trend == "unknown"


def test_of_few_draws_nothing_is_known() -> None:
    short = Diagnosis(math.nan, math.nan, "short")
    assert pair(short, Diagnosis(1.5, 10.0, "varies")) == Outlook("unknown", None)
    assert pair(short, short) == Outlook("unknown", None)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(1.0, 10.0), (31.0, 40.0), (130.0, 150.0), (700.0, 900.0), (4000.0, 7200.0), (60 * 3600.0, 3 * 86400.0)],
)
def test_times_are_rounded_up_to_what_people_say(seconds: float, said: float) -> None:
    assert rounded(seconds) == said
