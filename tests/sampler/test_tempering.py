"""Temperatures of a chain: when they begin, swaps, powers, images that follow; neither threads nor a stop matter."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.layout import pixel_centres
from prf.model.window import Window
from prf.results.convergence import disagree, worst_rhat
from prf.sampler import Ensemble
from prf.sampler import ensemble as ensembles
from prf.sampler import schedules as module
from prf.sampler.chain import LONGEST_BLOCK
from prf.sampler.checkpoint import load_checkpoint, save_checkpoint
from prf.sampler.ensemble import FIRST_LOOK, is_look
from prf.sampler.prepare import ladder_plan
from prf.sampler.schedules import (
    AUTO_TEMPERATURES,
    Ladder,
    LadderPlan,
    even_powers,
    penalised_log_likelihood,
    stretched_powers,
)
from prf.sampler.target import (
    Execution,
    Target,
    exchanged,
    make_chain,
    occupied_cost,
    repaint,
    with_map,
)
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest, structural_faults
from tests.reference.recompute import differences
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
UNEVEN = Window(-1.0, 2.0, 3.3, 5.1)


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.2, ROOM, Sensor(6.0), 2, 30, np.random.default_rng(1))


@pytest.fixture
def target(world: World) -> Target:
    return Target(ROOM, 0.2, world.data, execution=Execution(resolution=0.5))


def tempered(target: Target, plan: LadderPlan, threads: int = 1, blocks: int = 3) -> Ensemble:
    sampler = Ensemble(target, spawn_generators(7, 2), plan=plan)
    for _ in range(blocks):
        advance(sampler, threads)
    return sampler


def digests(sampler: Ensemble) -> list[dict[str, str]]:
    found = []
    for chain in sampler.chains:
        found.append(digest(chain.chain, chain.rng))
        if chain.ladder is not None:
            hot = zip(chain.ladder.hot, chain.ladder.generators, strict=True)
            found += [digest(each, rng) for each, rng in hot]
    return found


@pytest.mark.parametrize("lowest", [0.0, 0.3, None])
def test_what_follows_from_the_maps_still_does_after_swaps(target: Target, lowest: float | None) -> None:
    """Twins of every chain, among them the image of the cold one, whose map has come from elsewhere."""
    sampler = tempered(target, LadderPlan(4, lowest))
    for chain in sampler.chains:
        assert chain.ladder is not None
        assert chain.ladder.rate_sum[0] > 0.0
        for each in (chain.chain, *chain.ladder.hot):
            assert differences(each) == structural_faults(each) == []
            assert each.graph.counts[c.STEP] == sampler.step
        assert all(each.image.black.size == 0 for each in chain.ladder.hot)


def test_times_of_the_image_are_those_of_the_cold_chain(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorded maps and the image, which sees every step, say the same."""
    monkeypatch.setattr(module, "ADAPTATIONS", ())
    sampler = tempered(target, LadderPlan(3, 0.8), blocks=12)
    assert all((report["swap_rates"][0] or 0.0) > 0.05 for report in sampler.swaps())
    image = sampler.occupancy()[0].ravel()
    centres = pixel_centres(sampler.chains[0].chain.image.grid)
    share = np.mean([black_at(coloring, centres) for coloring in sampler.sample().draws], axis=0)
    assert np.corrcoef(image, share)[0, 1] > 0.97
    assert np.abs(image - share).mean() < 0.05


@pytest.mark.parametrize("lowest", [0.0, None])
def test_threads_change_no_result(target: Target, lowest: float | None) -> None:
    one, two = (tempered(target, LadderPlan(3, lowest), threads) for threads in (1, 2))
    assert digests(one) == digests(two)
    assert one.swaps() == two.swaps()


@pytest.mark.parametrize("lowest", [0.0, 0.3, None])
def test_a_stored_state_resumes_to_the_same_bits(target: Target, lowest: float | None, tmp_path: Path) -> None:
    """Stored right before the powers are moved, so that their measured rates count."""
    plan = LadderPlan(3, lowest)
    whole = tempered(target, plan, blocks=4)
    save_checkpoint(tmp_path, tempered(target, plan, blocks=2), "this run")
    again = Ensemble(target, spawn_generators(7, 2), plan=plan)
    load_checkpoint(tmp_path, again, "this run")
    for _ in range(2):
        advance(again)
    assert digests(again) == digests(whole)
    assert again.swaps() == whole.swaps()
    assert again.burn_in == whole.burn_in == 20_000
    assert np.array_equal(again.sample().draws.xy, whole.sample().draws.xy)
    pairs = zip(again.occupancy(), whole.occupancy(), strict=True)
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def test_burn_in_begins_anew_when_powers_move_and_they_stay_in_the_end(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ADAPTATIONS", (10_000, 20_000))
    burn_in, powers = [], []
    sampler = Ensemble(target, spawn_generators(7, 1), plan=LadderPlan(3))
    for _ in range(6):
        advance(sampler)
        burn_in.append(sampler.burn_in)
        powers.append(sampler.swaps()[0]["powers"])
        shares = sampler.occupancy()[1]
        assert shares.max() <= 1.0
        assert sampler.sample().step.min() > sampler.burn_in
    assert burn_in[:3] == [4000, 10_000, 20_000]
    assert powers[0] != powers[1] != powers[2] == powers[3] == powers[5]


def test_a_swap_leaves_the_joint_target_unchanged(target: Target) -> None:
    """The ratio is that of both densities, written out; a map with an occupied sensor is never cold."""
    rng = np.random.default_rng(3)
    cold = make_chain(target, Coloring.empty(ROOM))
    tempering = Ladder(target, cold, rng, LadderPlan(4, 0.0, 3.0))
    tempering.powers[:] = [1.0, 0.7, 0.2, 0.0]
    draws = exact_draws(0.2, ROOM, 12, rng)
    chains = [with_map(tempering.hot[0], target, draw) for draw in draws]
    chains = [chain._replace(beams=chain.beams._replace(ray=chain.beams.ray.copy())) for chain in chains]
    occupied = [int(black_at(draw, np.unique(target.laser.readings.origin, axis=0)).sum()) for draw in draws]
    assert 0 < sum(n > 0 for n in occupied) < len(occupied)

    def log_target(temperature: int, k: int) -> float:
        power = float(tempering.powers[temperature])
        if temperature == 0 and occupied[k]:
            return -math.inf
        return power * (float(chains[k].graph.sums[c.LOG_LIKELIHOOD]) - 3.0 * occupied[k])

    for pair, i, j in itertools.product(range(3), range(12), range(12)):
        if i == j or (pair == 0 and occupied[i]):
            continue
        swapped = log_target(pair, j) + log_target(pair + 1, i)
        expected = swapped - log_target(pair, i) - log_target(pair + 1, j)
        assert tempering.log_swap_ratio(pair, chains[i], chains[j]) == pytest.approx(expected, abs=1e-9)


def test_exchanged_chains_keep_what_belongs_to_a_temperature(target: Target) -> None:
    one = make_chain(target, Coloring.empty(ROOM))
    draw = exact_draws(0.2, ROOM, 1, np.random.default_rng(5))[0]
    other = with_map(make_chain(target, Coloring.empty(ROOM)), target, draw)
    other.density[c.OCCUPIED_COST] = 1.0
    first, second = exchanged(one, other)
    assert first.graph is other.graph
    assert second.beams is one.beams
    assert first.density is one.density
    assert first.image is one.image
    repaint(first)
    repaint(second)
    first.density[c.OCCUPIED_COST] = 1.0
    assert differences(first) == differences(second) == []


@pytest.mark.parametrize("scale", [0.2, 1.0])
@pytest.mark.parametrize(("window", "resolution"), [(ROOM, 0.37), (ROOM, 0.5), (UNEVEN, 0.1), (UNEVEN, 1.0)])
def test_a_repainted_image_has_the_colours_of_the_map(window: Window, resolution: float, scale: float) -> None:
    target = Target(window, scale, execution=Execution(resolution=resolution))
    chain = make_chain(target, exact_draws(scale, window, 1, np.random.default_rng(0))[0])
    for draw in exact_draws(scale, window, 20, np.random.default_rng(1)):
        placed = with_map(chain, target, draw)
        repaint(placed)
        assert differences(placed) == []


@pytest.mark.parametrize("lowest", [0.05, 0.0])
def test_even_powers_divide_a_known_barrier(lowest: float) -> None:
    """A barrier of 3 log(1/power): evenly refused where the logarithms are evenly spaced."""

    def refusals(powers: np.ndarray) -> np.ndarray:
        barrier = 3.0 * np.log1p(20.0 * (1.0 - powers))
        return np.diff(barrier) / 10.0

    powers = np.append(np.geomspace(1.0, max(lowest, 0.3), 7)[:-1], lowest)
    for _ in range(20):
        powers = even_powers(powers, refusals(powers))
        assert (np.diff(powers) < 0.0).all()
    assert powers[[0, -1]].tolist() == [1.0, lowest]
    assert refusals(powers) == pytest.approx(refusals(powers).mean(), rel=0.02)


def test_powers_reach_further_where_swaps_succeed_and_less_far_where_they_fail() -> None:
    powers = np.geomspace(1.0, 0.5, 4)
    assert stretched_powers(powers, 0.25)[-1] == pytest.approx(0.25)
    assert stretched_powers(powers, 1.0)[-1] == pytest.approx(math.sqrt(0.5))
    assert stretched_powers(powers, 0.5) == pytest.approx(powers)
    assert stretched_powers(np.array([1.0, 0.002]), 0.01)[-1] == pytest.approx(1e-3)


def test_a_round_trip_is_from_the_cold_chain_to_the_hottest_and_back() -> None:
    target = Target(ROOM, 0.2)
    ladder = Ladder(target, make_chain(target, Coloring.empty(ROOM)), np.random.default_rng(1), LadderPlan(3))
    ladder.follow(1)
    assert ladder.round_trips == 0
    ladder.follow(0)
    assert ladder.round_trips == 1
    for pair in (0, 0, 0):
        ladder.follow(pair)
    assert ladder.round_trips == 1
    ladder.follow(1)
    ladder.follow(1)
    ladder.follow(0)
    assert ladder.round_trips == 2


def test_the_cost_of_a_sensor_is_what_its_readings_are_worth(target: Target) -> None:
    """30 readings each, of noise 3 cm where 6 m are in reach and one of 20 is stray."""
    peak = 1.0 / (math.sqrt(2.0 * math.pi) * 0.03)
    assert occupied_cost(target, 2) == pytest.approx(30 * math.log1p(peak * 6.0 / 0.05))
    assert occupied_cost(Target(ROOM, 0.2), 0) == 5.0


def test_energy_counts_occupied_sensors(target: Target) -> None:
    chain = make_chain(target, Coloring.empty(ROOM))
    assert penalised_log_likelihood(chain, math.inf) == chain.graph.sums[c.LOG_LIKELIHOOD]
    chain.graph.counts[c.OCCUPIED] = 2
    assert penalised_log_likelihood(chain, 7.0) == pytest.approx(chain.graph.sums[c.LOG_LIKELIHOOD] - 14.0)


WAITING = LadderPlan(3, waits=True)


def look_at(monkeypatch: pytest.MonkeyPatch, step: int, verdict: bool) -> None:
    monkeypatch.setattr(ensembles, "FIRST_LOOK", step)
    monkeypatch.setattr(ensembles, "disagree", lambda before, now: verdict)


def advanced(sampler: Ensemble, step: int, threads: int = 1) -> Ensemble:
    while sampler.step < step:
        advance(sampler, threads)
    return sampler


def fresh(target: Target, plan: LadderPlan = WAITING) -> Ensemble:
    return Ensemble(target, spawn_generators(7, 2), plan)


def test_looks_are_at_doublings_that_every_block_meets() -> None:
    looks = [step for step in range(0, 6_000_000, 10_000) if is_look(step)]
    assert looks == [640_000, 1_280_000, 2_560_000, 5_120_000]
    assert FIRST_LOOK % LONGEST_BLOCK == 0


@pytest.mark.parametrize(("shift", "expected"), [(0.0, False), (50.0, True)])
def test_draws_of_both_times_are_compared(
    target: Target, monkeypatch: pytest.MonkeyPatch, shift: float, expected: bool
) -> None:
    """Chains that are given other values, all the way, are apart; those with the same ones are not."""
    sampler = advanced(fresh(target), 120_000)
    for number, chain in enumerate(sampler.chains):
        for draw in chain.record.draws:
            draw.functionals[:] = draw.step // 2000 % 3 + number * shift
            draw.probe_black[:] = False
    seen = []
    monkeypatch.setattr(ensembles, "disagree", lambda before, now: seen.append((list(before), list(now))) or True)
    assert sampler.disagree()
    ((before, now),) = seen
    assert disagree(before, now) is expected
    assert sampler.burn_in == 32_000
    assert (worst_rhat(before) > 1.05, worst_rhat(now) > 1.05) == (expected, expected)


def test_tempering_begins_at_the_look_and_burn_in_anew(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    look_at(monkeypatch, 20_000, True)
    sampler = advanced(fresh(target), 20_000)
    assert sampler.swaps() == []
    assert sampler.n_temperatures == 1
    assert sampler.burn_in == 8_000, "a run that ends at a look keeps its draws"
    advanced(again := fresh(target), 30_000)
    assert again.n_temperatures == 3
    assert [report["first_step"] for report in again.swaps()] == [20_000, 20_000]
    assert again.burn_in == 20_000
    assert again.sample().step.min() > 20_000


def test_chains_that_do_not_disagree_remain_plain(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    look_at(monkeypatch, 10_000, False)
    plain = advanced(fresh(target, LadderPlan(1)), 40_000)
    assert digests(advanced(fresh(target), 40_000)) == digests(plain)


@pytest.mark.parametrize("stop", [10_000, 20_000, 30_000], ids=["before", "at the look", "after"])
def test_a_resumed_run_is_the_run_in_one(
    target: Target, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, stop: int
) -> None:
    look_at(monkeypatch, 20_000, True)
    whole = advanced(fresh(target), 60_000, threads=2)
    save_checkpoint(tmp_path, advanced(fresh(target), stop), "same")
    resumed = fresh(target)
    load_checkpoint(tmp_path, resumed, "same")
    assert digests(advanced(resumed, 60_000)) == digests(whole)
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
