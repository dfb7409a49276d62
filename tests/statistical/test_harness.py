"""What `python -m tests.statistical` is made of, on few worlds: right samplers pass, wrong ones do not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.sampler.target import make_chain, run_chain
from tests.reference.free_way import is_free
from tests.statistical import ways
from tests.statistical.__main__ import main
from tests.statistical.check import Check, settled
from tests.statistical.controls import control_arms, rougher
from tests.statistical.images import by_loops, by_sampler, compare
from tests.statistical.joint import ACCELERATED, PLAIN, Program, run_joint
from tests.statistical.problems import NAMES, PROBLEMS, laser_problem, small_station
from tests.statistical.sbc import run_arm
from tests.statistical.ways import N_DRAWS, WAYS, unbounded

SEED = 20261121


@pytest.fixture
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ways, "FIRST_STEPS", 80_000)
    monkeypatch.setattr(ways, "MOST_STEPS", 80_000)


def check(name: str, inside: bool, is_control: bool = False) -> Check:
    return Check(name, "found", "allowed", inside, 1.0, is_control)


def test_a_check_outside_its_band_is_repeated_once() -> None:
    seeds = []

    def run_checks(seed: int) -> list[Check]:
        seeds.append(seed)
        return [check("right", True), check("unlucky", seed != 7), check("wrong", False), check("control", False, True)]

    found = {one.name: one for one in settled(run_checks, 7)}
    assert seeds == [7, 1007]
    assert {name: one.passed for name, one in found.items()} == {
        "right": True,
        "unlucky": True,
        "wrong": False,
        "control": True,
    }
    assert found["unlucky"].statistic.endswith("outside at first: found")
    assert found["wrong"].line().startswith("FAIL wrong")


def test_a_control_that_passes_fails() -> None:
    assert not check("control", True, is_control=True).passed
    assert [one.passed for one in settled(lambda seed: [check("control", False, True)], 1)] == [True]


@pytest.mark.parametrize("kind", PROBLEMS)
def test_worlds_have_their_sensors_in_white(kind: str) -> None:
    for number in range(5):
        problem = PROBLEMS[kind](np.random.default_rng([SEED, number]))
        assert is_free(problem.target, problem.truth)


def test_slow_oracles_and_kernels_agree_on_a_map() -> None:
    station, rng = small_station(), np.random.default_rng(SEED)
    target = station.read(station.draw_map(rng), rng)
    for _ in range(10):
        draw = station.draw_map(rng)
        slow = station.log_likelihood(target, draw)
        assert make_chain(target, draw).graph.sums[2] == pytest.approx(slow, abs=1e-6)


def test_bounds_change_no_step() -> None:
    """With the same random numbers a chain that asks all readings goes the way of one that rejects early."""
    target = laser_problem(np.random.default_rng(SEED)).target.with_execution(levels=1, resolution=None)
    chains = [make_chain(target, Coloring.empty(target.window)) for _ in range(2)]
    chains[1] = unbounded(chains[1])
    generators = [np.random.default_rng(SEED) for _ in range(2)]
    for until in range(2000, 20_001, 2000):
        for k in range(2):
            chains[k] = run_chain(chains[k], generators[k], until)
        first, second = (read_coloring(chain.graph) for chain in chains)
        assert np.array_equal(first.xy, second.xy)
        assert np.array_equal(first.edges, second.edges)


@pytest.mark.slow
def test_only_the_likelihood_distinguishes_prior_and_posterior() -> None:
    arm = next(arm for arm in control_arms() if "prior" in arm.name)
    assert run_arm(arm, 40, SEED, 1).outside().keys() == {"log likelihood"}


def test_chains_that_are_stopped_too_early_leave_the_band() -> None:
    arm = next(arm for arm in control_arms() if "early" in arm.name)
    assert "black area" in run_arm(arm, 25, SEED, 1).outside()


@pytest.mark.parametrize("way", WAYS)
def test_every_way_returns_as_many_draws_with_sensors_in_white(way: str, few_steps: None) -> None:
    rng = np.random.default_rng(SEED)
    problem = laser_problem(rng)
    answer = WAYS[way](problem.target, rng, 2)
    assert len(answer.draws) == N_DRAWS
    assert all(is_free(problem.target, draw) for draw in answer.draws)


@pytest.mark.slow
def test_the_command_writes_its_plots_and_figures(tmp_path: Path, few_steps: None) -> None:
    lines: list[str] = []
    code = main(["--part", "laser-plain", "--worlds", "2", "--output", str(tmp_path / "out")], lines.append)
    found = json.loads((tmp_path / "out" / "verify.json").read_text())
    assert code == int(any(not one["passed"] for one in found["checks"]))
    assert len(lines) == len(found["checks"]) + 1 == len(NAMES) + 2
    assert len(found["figures"]["ranks-laser-plain-1"]["ranks"]["length"]) == 2
    assert (tmp_path / "out" / "ranks-laser-plain-1.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_wrong_noise_leaves_the_band() -> None:
    arm = next(arm for arm in control_arms() if "noise" in arm.name)
    assert "log likelihood" in run_arm(arm, 60, SEED, 1).outside()


@pytest.mark.slow
@pytest.mark.parametrize("program", [PLAIN, ACCELERATED], ids=["plain", "accelerated"])
def test_maps_and_readings_keep_their_joint_law(program: Program) -> None:
    """Sixteen quantities at 99.9 % together: the limit at 30 chains is 4.8."""
    found = run_joint(small_station(), program, 30, 20, 500, SEED)
    assert np.abs(found.z).max() < 4.8, found.z


@pytest.mark.slow
def test_a_joint_law_with_another_prior_is_caught() -> None:
    found = run_joint(small_station(), PLAIN._replace(spoil=rougher), 30, 20, 500, SEED)
    assert np.abs(found.z).max() > 6.0, found.z


@pytest.mark.slow
def test_two_samplers_agree_on_an_image() -> None:
    station, rng = small_station(0.25), np.random.default_rng(SEED)
    target = station.read(station.draw_map(rng), rng)
    loops = by_loops(station, target, 4, 6000, SEED)
    found = compare(loops, by_sampler(target, None, 4, 640_000, SEED, 2))
    assert np.abs(found.z).max() < 4.5, found.z
