"""Chains that wait for tempering: when it begins, and that neither a stop nor threads change what comes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import Configuration
from prf.diagnostics import Diagnosis
from prf.posterior import Settings
from prf.sampler import Sampler, chains, convergence
from prf.sampler.chain import LONGEST_BLOCK
from prf.sampler.checkpoint import load_checkpoint, save_checkpoint
from prf.sampler.config import ladder_plan
from prf.sampler.convergence import FIRST_LOOK, disagree, is_look, worst_rhat
from prf.sampler.tempering import AUTO_TEMPERATURES, LadderPlan
from prf.shell.seeds import spawn_generators
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
WAITING = LadderPlan(3, waits=True)


@pytest.fixture(scope="module")
def settings() -> Settings:
    world = draw_world(0.2, ROOM, Sensor(6.0), 2, 30, np.random.default_rng(1))
    return Settings(ROOM, 0.2, world.data, resolution=0.5)


def look_at(monkeypatch: pytest.MonkeyPatch, step: int, verdict: bool) -> None:
    monkeypatch.setattr(convergence, "FIRST_LOOK", step)
    monkeypatch.setattr(chains, "disagree", lambda before, now: verdict)


def advanced(sampler: Sampler, step: int) -> Sampler:
    with sampler:
        while sampler.step < step:
            sampler.advance()
    return sampler


def fresh(settings: Settings, plan: LadderPlan = WAITING, threads: int = 1) -> Sampler:
    return Sampler(settings, spawn_generators(7, 2), threads, plan=plan)


def state(sampler: Sampler) -> list[dict[str, str]]:
    found = [digest(chain.chain, chain.rng) for chain in sampler.chains]
    for tempering in (chain.tempering for chain in sampler.chains if chain.tempering is not None):
        found += [digest(each, rng) for each, rng in zip(tempering.hot, tempering.generators, strict=True)]
    return found


def test_looks_are_at_doublings_that_every_block_meets() -> None:
    looks = [step for step in range(0, 6_000_000, 10_000) if is_look(step)]
    assert looks == [640_000, 1_280_000, 2_560_000, 5_120_000]
    assert FIRST_LOOK % LONGEST_BLOCK == 0


def diagnoses(*values: float) -> list[Diagnosis]:
    return [Diagnosis(rhat, 200.0, "stuck" if math.isinf(rhat) else "varies") for rhat in values]


def test_the_worst_counts() -> None:
    assert worst_rhat(diagnoses(1.01, 1.4, math.nan)) == 1.4
    assert worst_rhat(diagnoses(1.01, math.inf)) == math.inf
    assert worst_rhat(diagnoses(math.nan)) == 1.0
    assert worst_rhat([]) == 1.0


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


@pytest.mark.parametrize(("shift", "expected"), [(0.0, False), (50.0, True)])
def test_draws_of_both_times_are_compared(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, shift: float, expected: bool
) -> None:
    """Chains that are given other values, all the way, are apart; those with the same ones are not."""
    sampler = advanced(fresh(settings), 120_000)
    for number, chain in enumerate(sampler.chains):
        for draw in chain.record.draws:
            draw.functionals[:] = draw.step // 2000 % 3 + number * shift
            draw.probe_black[:] = False
    seen = []
    monkeypatch.setattr(chains, "disagree", lambda before, now: seen.append((list(before), list(now))) or True)
    assert sampler.disagree()
    ((before, now),) = seen
    assert disagree(before, now) is expected
    assert sampler.burn_in == 32_000
    assert (worst_rhat(before) > 1.05, worst_rhat(now) > 1.05) == (expected, expected)


def test_tempering_begins_at_the_look_and_burn_in_anew(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    look_at(monkeypatch, 20_000, True)
    sampler = advanced(fresh(settings), 20_000)
    assert sampler.swaps() == []
    assert sampler.n_temperatures == 1
    assert sampler.burn_in == 8_000, "a run that ends at a look keeps its draws"
    advanced(again := fresh(settings), 30_000)
    assert again.n_temperatures == 3
    assert [report.first_step for report in again.swaps()] == [20_000, 20_000]
    assert again.burn_in == 20_000
    assert again.sample().step.min() > 20_000


def test_chains_that_do_not_disagree_remain_plain(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    look_at(monkeypatch, 10_000, False)
    plain = advanced(fresh(settings, LadderPlan(1)), 40_000)
    assert state(advanced(fresh(settings), 40_000)) == state(plain)


@pytest.mark.parametrize("stop", [10_000, 20_000, 30_000], ids=["before", "at the look", "after"])
def test_a_resumed_run_is_the_run_in_one(
    settings: Settings, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stop: int
) -> None:
    look_at(monkeypatch, 20_000, True)
    whole = advanced(fresh(settings, threads=2), 60_000)
    save_checkpoint(tmp_path, advanced(fresh(settings), stop), "same")
    resumed = fresh(settings)
    load_checkpoint(tmp_path, resumed, "same")
    assert state(advanced(resumed, 60_000)) == state(whole)
    assert resumed.swaps() == whole.swaps()
    assert resumed.burn_in == whole.burn_in
    assert np.array_equal(resumed.sample().draws.xy, whole.sample().draws.xy)
    pairs = zip(resumed.occupancy(), whole.occupancy(), strict=True)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def test_a_configuration_says_whether_tempering_waits() -> None:
    assert ladder_plan(Configuration.of(temperatures="auto")) == LadderPlan(AUTO_TEMPERATURES, None, waits=True)
    assert ladder_plan(Configuration.of(temperatures="auto", lowest_inverse_temperature=0.5)) == LadderPlan(
        AUTO_TEMPERATURES, 0.5, waits=True
    )
    assert ladder_plan(Configuration.of(temperatures=3)) == LadderPlan(3)
    assert [Configuration.of(temperatures=n).sampler.is_tempered for n in (1, 2, "auto")] == [False, True, True]
