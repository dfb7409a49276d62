"""When a run ends: after steps, after seconds, on agreement, or at the limit; and where agreement is checked."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from prf.configuration import Configuration
from prf.model.coloring import Coloring
from prf.model.window import Window
from prf.results import Progress
from prf.results.convergence import Diagnosis, Verdict
from prf.sampler import ChainRun, Ensemble, StopRule, chain, drive, session
from prf.sampler.session import FIRST_SECONDS, MOST_SLOWED, PICTURE_SECONDS, is_check
from prf.sampler.target import Execution, Target
from prf.shell.cli.storage import spawn_generators

UNIT = Window(0.0, 0.0, 1.0, 1.0)


@pytest.fixture
def sampler() -> Ensemble:
    return Ensemble(Target(UNIT, 1.0, execution=Execution(resolution=0.25)), spawn_generators(1, 2))


class Clock:
    """Says one second more whenever it is asked."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1.0
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(session, "time", SimpleNamespace(monotonic=made, time=lambda: 0.0))
    return made


@pytest.mark.parametrize(("steps", "ends"), [(1, 10_000), (10_000, 10_000), (25_000, 30_000)])
def test_steps_are_rounded_up_to_whole_rounds(sampler: Ensemble, steps: int, ends: int) -> None:
    rounds = list(drive(sampler, StopRule(steps=steps)))
    assert [found.step for found in rounds] == list(range(10_000, ends + 1, 10_000))
    assert [found.status for found in rounds] == ["running"] * (len(rounds) - 1) + ["finished"]
    assert rounds[-1].share == 1.0
    assert sampler.step == ends


def test_a_goal_that_is_reached_already_does_nothing(sampler: Ensemble) -> None:
    assert list(drive(sampler, StopRule(steps=0))) == []
    list(drive(sampler, StopRule(steps=20_000)))
    assert list(drive(sampler, StopRule(steps=20_000))) == []
    assert [found.step for found in drive(sampler, StopRule(steps=30_000))] == [30_000]


def test_a_run_in_two_parts_is_the_run_in_one(sampler: Ensemble) -> None:
    list(drive(sampler, StopRule(steps=20_000)))
    list(drive(sampler, StopRule(steps=50_000)))
    whole = Ensemble(Target(UNIT, 1.0, execution=Execution(resolution=0.25)), spawn_generators(1, 2))
    list(drive(whole, StopRule(steps=50_000)))
    one, two = sampler.sample(), whole.sample()
    assert np.array_equal(one.draws.xy, two.draws.xy)
    assert all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(sampler.occupancy(), whole.occupancy(), strict=True)
    )


def test_seconds_are_those_of_the_clock(sampler: Ensemble, clock: Clock) -> None:
    """A round takes one second, and one goes by between two rounds."""
    rounds = list(drive(sampler, StopRule(seconds=6.0)))
    assert [found.seconds for found in rounds] == [2.0, 4.0, 6.0]
    assert [found.status for found in rounds] == ["running", "running", "finished"]
    assert [found.share for found in rounds] == pytest.approx([2.5 / 6, 4.5 / 6, 1.0])
    assert [found.steps_per_second for found in rounds] == pytest.approx([10_000.0] * 3)


@pytest.mark.parametrize(("budget", "reserve", "rounds"), [(6.6, 0.0, 4), (6.4, 0.0, 3), (6.6, 2.0, 3), (6.6, 99.0, 1)])
def test_the_last_round_ends_nearest_to_what_is_left(
    sampler: Ensemble, clock: Clock, budget: float, reserve: float, rounds: int
) -> None:
    found = list(drive(sampler, StopRule(seconds=budget), reserve=lambda: reserve))
    assert [each.seconds for each in found] == [2.0 * (k + 1) for k in range(rounds)]
    assert found[-1].share == 1.0


def test_speed_leaves_out_the_steps_of_an_earlier_run(sampler: Ensemble, clock: Clock) -> None:
    list(drive(sampler, StopRule(steps=50_000)))
    (found,) = drive(sampler, StopRule(steps=60_000))
    assert found.steps_per_second == pytest.approx(10_000.0)


def test_without_a_goal_it_stops_on_agreement(sampler: Ensemble, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def agree_later(diagnoses: dict[str, Diagnosis]) -> Verdict:
        asked.append(sampler.step)
        return Verdict(sampler.step >= 40_000, "", "", False)

    monkeypatch.setattr(session, "verdict", agree_later)
    rounds = list(drive(sampler, StopRule()))
    assert rounds[-1].status == "converged"
    assert rounds[-1].step == 40_000
    assert rounds[-1].diagnoses is not None
    assert asked == [10_000, 20_000, 30_000, 40_000]


def test_the_share_that_is_shown_never_falls(sampler: Ensemble, monkeypatch: pytest.MonkeyPatch) -> None:
    found = iter([1.1, 2.0, 1.5, 1.0])
    monkeypatch.setattr(StopRule, "share", lambda *_: 1.0 / next(found))
    assert [round(each.share, 2) for each in drive(sampler, StopRule(steps=40_000))] == [0.91, 0.91, 0.91, 1.0]


def test_chains_that_agree_stop_by_themselves(sampler: Ensemble) -> None:
    """No readings, a small window: agreement comes within seconds, on the real measure."""
    *_, last = drive(sampler, StopRule(limit=120.0))
    assert isinstance(last, Progress)
    assert last.status == "converged"
    assert last.diagnoses is not None
    assert all(found.agrees() for found in last.diagnoses.values())


def test_without_agreement_it_stops_at_the_limit(
    sampler: Ensemble, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "verdict", lambda _: Verdict(False, "", "", False))
    rounds = list(drive(sampler, StopRule(limit=8.0)))
    assert [found.status for found in rounds] == ["running"] * 3 + ["not converged"]
    assert [found.share for found in rounds] == pytest.approx([2.5 / 8, 4.5 / 8, 6.5 / 8, 1.0])


def test_agreement_does_not_end_a_run_with_a_goal(
    sampler: Ensemble, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "verdict", lambda _: Verdict(True, "", "", True))
    assert list(drive(sampler, StopRule(steps=30_000)))[-1].step == 30_000
    assert list(drive(sampler, StopRule(seconds=2.0)))[-1].seconds == 2.0


def test_checks_come_at_growing_distances(sampler: Ensemble, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every round at first, then each at least 1 and about a tenth later than the one before; no clock asked."""
    checked = []
    for block in range(1, 2001):
        monkeypatch.setattr(type(sampler), "step", property(lambda self, block=block: 10_000 * block))
        if is_check(sampler):
            checked.append(block)
    assert checked[:12] == list(range(1, 13))
    gaps = np.diff(checked)
    assert (gaps >= 1).all()
    late = np.array(checked[:-1]) >= 20
    assert (gaps[late] <= 0.1 * np.array(checked[:-1])[late]).all()
    assert (gaps[late] > 0.1 * np.array(checked[:-1])[late] - 1.0).all()


def test_an_early_exit_leaves_the_chains_between_rounds(sampler: Ensemble) -> None:
    for found in drive(sampler, StopRule(steps=100_000)):
        if found.step == 20_000:
            break
    assert {chain.step for chain in sampler.chains} == {20_000}


@pytest.mark.parametrize(
    ("rule", "late"), [(StopRule(seconds=100.0), True), (StopRule(limit=100.0), True), (StopRule(steps=10_000), False)]
)
def test_the_search_for_starts_has_a_share_of_the_time_and_happens_once(
    sampler: Ensemble, monkeypatch: pytest.MonkeyPatch, rule: StopRule, late: bool
) -> None:
    given: list[float] = []
    monkeypatch.setattr(ChainRun, "find_start", lambda chain, latest, stop: given.append(latest - time.time()) or chain)
    next(iter(drive(sampler, rule)))
    assert given == [pytest.approx(30.0, abs=1.0) if late else math.inf] * 2
    next(iter(drive(sampler, StopRule(steps=20_000))))
    assert len(given) == 2


def test_the_search_for_a_start_ends_with_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(chain.time, "time", lambda: now[0])
    answers = []

    def search(start: str, target: Target, rng: np.random.Generator, is_over: Callable[[], bool]) -> Coloring:
        for now[0] in (0.0, 4.0, 5.0, 6.0):
            answers.append(is_over())
        return Coloring.empty(UNIT)

    monkeypatch.setattr(chain, "find_start_map", search)
    run = ChainRun(Target(UNIT, 1.0), np.random.default_rng(1), np.zeros(0, np.int64), starts_from="prior")
    run.find_start(5.0, lambda: False)
    assert answers == [False, False, False, True]


def test_a_request_to_stop_ends_the_search_for_starts(sampler: Ensemble, monkeypatch: pytest.MonkeyPatch) -> None:
    answers: list[bool] = []
    monkeypatch.setattr(ChainRun, "find_start", lambda chain, latest, stop: answers.append(stop()) or chain)
    next(iter(drive(sampler, StopRule(steps=10_000), stop_requested=lambda: True)))
    assert answers == [True, True]


def test_the_share_of_agreement_is_what_the_worst_diagnosis_falls_short() -> None:
    halfway = {"log_likelihood": Diagnosis(1.01, 50.0, "varies"), "colour": Diagnosis(1.0, 400.0, "varies")}
    assert StopRule().share(10, 0.0, halfway) == pytest.approx(0.5)
    assert StopRule(limit=1000.0).share(10, 900.0, halfway) == pytest.approx(0.9)
    assert StopRule(steps=100).share(10, 0.0, halfway) == pytest.approx(0.1)


@pytest.mark.parametrize(("cpu", "slowed"), [(20.0, 1.0), (8.0, 2.5), (1.0, MOST_SLOWED), (0.0, MOST_SLOWED)])
def test_the_end_is_taken_to_last_longer_beside_other_processes(
    sampler: Ensemble, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cpu: float, slowed: float
) -> None:
    """In ten seconds by the clock two threads had so many of the processor."""
    run = session.Session(sampler, Configuration(), 1, {}, tmp_path, threads=2)
    run.opened = 100.0, 7.0
    monkeypatch.setattr("time.monotonic", lambda: 110.0)
    monkeypatch.setattr("time.process_time", lambda: 7.0 + cpu)
    assert run.seconds_to_finish() == pytest.approx(slowed * (FIRST_SECONDS + PICTURE_SECONDS))
    run.seconds_to_write = 3.0  # as it was measured, beside the others too
    assert run.seconds_to_finish() == pytest.approx(3.0 + slowed * PICTURE_SECONDS)
