"""Chains side by side: results that know nothing of threads or of one another, and what is pooled from them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import prf.sampler.chain
from prf.kernels import constants as c
from prf.model.coloring import Draws, black_at, violations
from prf.model.layout import pixel_centres
from prf.model.window import Window
from prf.sampler import Ensemble
from prf.sampler.chain import FUNCTIONALS
from prf.sampler.ensemble import probe_pixels
from prf.sampler.target import Execution, Target
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
UNEVEN = Window(-1.0, 2.0, 3.3, 5.1)


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.2, ROOM, Sensor(6.0), 2, 30, np.random.default_rng(1))


def run_chains(world: World, n_chains: int, threads: int, blocks: int = 3) -> Ensemble:
    sampler = Ensemble(
        Target(ROOM, 0.2, world.data, execution=Execution(resolution=0.5)), spawn_generators(7, n_chains)
    )
    for _ in range(blocks):
        advance(sampler, threads)
    return sampler


def digests(sampler: Ensemble) -> list[dict[str, str]]:
    return [digest(chain.chain, chain.rng) for chain in sampler.chains]


@pytest.fixture(scope="module")
def four(world: World) -> Ensemble:
    return run_chains(world, 4, 1)


def same_draws(one: Draws, two: Draws) -> bool:
    names = ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black")
    return all(np.array_equal(getattr(one, name), getattr(two, name)) for name in names)


@pytest.mark.parametrize("threads", [2, 16])
def test_threads_change_no_result(world: World, four: Ensemble, threads: int) -> None:
    other = run_chains(world, 4, threads)
    assert digests(other) == digests(four)
    one, two = four.sample(), other.sample()
    assert same_draws(one.draws, two.draws)
    assert np.array_equal(one.step, two.step)
    assert all(np.array_equal(one.functionals[name], two.functionals[name]) for name in FUNCTIONALS)
    assert all(np.array_equal(a, b) for a, b in zip(four.occupancy(), other.occupancy(), strict=True))
    assert other.diagnose() == four.diagnose()


def test_a_fifth_chain_leaves_the_first_four_alone_until_they_aim_by_what_all_of_them_saw(world: World) -> None:
    four, five = (run_chains(world, n, 2, blocks=1) for n in (4, 5))
    assert digests(five)[:4] == digests(four)
    aims = [sampler.chains[0].chain.targets.cumulative for sampler in (four, five)]
    assert not np.array_equal(*aims)


def test_the_sample_holds_what_the_chains_recorded_after_burn_in(four: Ensemble) -> None:
    sample = four.sample()
    assert four.step == 30_000
    assert four.burn_in == 8000
    assert sample.step.min() == 10_000
    assert sample.step.max() == 30_000
    n = len(sample.draws)
    assert len(sample.chain) == len(sample.step) == n == 4 * 11
    assert sample.chain.tolist() == sorted(sample.chain.tolist())
    assert np.array_equal(sample.functionals["n_edges"], sample.draws.n_edges)
    assert sample.functionals["total_length"] == pytest.approx(sample.draws.total_length())
    total = sample.functionals["log_prior"] + sample.functionals["log_likelihood"]
    assert sample.functionals["log_posterior"] == pytest.approx(total)
    for i in range(0, n, 7):
        assert violations(sample.draws[i]) == []
        assert sample.probe_black[i].tolist() == black_at(sample.draws[i], four.probe_xy).tolist()


def test_no_sensor_is_in_black(world: World, four: Ensemble) -> None:
    for coloring in four.sample().draws:
        assert not black_at(coloring, world.data.readings.origin).any()


def test_the_best_map_has_the_highest_log_posterior_of_all_draws(four: Ensemble) -> None:
    best = four.best()
    assert best is not None
    recorded = [draw for chain in four.chains for draw in chain.record.draws]
    assert best.functionals[-1] == max(draw.functionals[-1] for draw in recorded)
    assert any(best is draw for draw in recorded)


def test_before_the_first_draw_there_is_no_best_map_and_no_image(world: World) -> None:
    sampler = run_chains(world, 2, 1, blocks=0)
    assert sampler.best() is None
    assert len(sampler.sample().draws) == 0
    assert sampler.sample().probe_black.shape[0] == 0
    assert np.isnan(sampler.occupancy()).all()
    assert set(sampler.diagnose()) >= set(FUNCTIONALS)
    assert not any(found.agrees() for found in sampler.diagnose().values())


def test_occupancy_is_the_mean_over_chains(four: Ensemble) -> None:
    shares = four.occupancy()
    for which in range(2):
        totals = [chain.record.times(chain.chain.image, four.step)[which] for chain in four.chains]
        expected = np.sum(totals, axis=0) / (4 * (four.step - four.burn_in))
        assert shares[which].ravel() == pytest.approx(expected, abs=1e-6)
        assert shares[which].shape == (20, 20)
        assert shares[which].min() >= 0.0
        assert shares[which].max() <= 1.0
    assert (shares[1] >= shares[0]).all()


def test_occupancy_agrees_with_the_draws(four: Ensemble) -> None:
    """Few draws, all steps: they estimate the same thing, so that a mirrored or shifted image would show."""
    image = four.occupancy()[0].ravel()
    centres = pixel_centres(four.chains[0].chain.image.grid)
    draws = four.sample().draws
    share = np.mean([black_at(coloring, centres) for coloring in draws], axis=0)
    assert np.corrcoef(image, share)[0, 1] > 0.97
    assert np.abs(image - share).mean() < 0.05


def test_occupancy_is_unknown_outside_the_window() -> None:
    """The window ends within the last column and row of pixels, before their centres."""
    target = Target(UNEVEN, 0.5, execution=Execution(resolution=1.0))
    sampler = Ensemble(target, spawn_generators(1, 2))
    advance(sampler)
    for share in sampler.occupancy():
        assert share.shape == (4, 5)
        assert share.dtype == np.float32
        assert np.isnan(share[:, 4]).all()
        assert np.isnan(share[3]).all()
        assert np.isfinite(share[:3, :4]).all()


def test_disagreement_is_the_largest_difference_of_two_chains(four: Ensemble) -> None:
    steps = four.step - four.burn_in
    black = np.array([chain.record.times(chain.chain.image, four.step)[0] for chain in four.chains]) / steps
    pairs = [np.abs(one - other) for one in black for other in black]
    assert four.disagreement().ravel() == pytest.approx(np.max(pairs, axis=0), abs=1e-6)
    assert four.disagreement().max() > 0.0


def test_chains_climb_from_the_empty_map_and_settle(four: Ensemble, monkeypatch: pytest.MonkeyPatch) -> None:
    draws = four.recorded()[0][:4]
    for values, climbs in (([1.0, 2.0, 3.0, 4.0], True), ([3.0, 1.0, 2.0, 1.5], False)):
        made = [dataclasses.replace(draw, functionals=np.array([x])) for draw, x in zip(draws, values, strict=True)]
        monkeypatch.setattr(four, "recorded", lambda made=made: [made, made])
        assert four.climbs() is climbs


def test_one_chain_disagrees_with_nobody(world: World) -> None:
    assert np.isnan(run_chains(world, 1, 1, blocks=1).disagreement()).all()
    assert np.isnan(run_chains(world, 2, 1, blocks=0).disagreement()).all()


def test_seen_and_unseen_ground_have_probes_of_their_own() -> None:
    seen = np.zeros((20, 20), np.bool_)
    seen[:, :7] = True  # of the second column of blocks the two left columns of pixels
    target = Target(ROOM, 0.2, seen=seen, execution=Execution(resolution=0.5))
    sampler = Ensemble(target, spawn_generators(1, 2))
    xy, unseen = sampler.probe_xy, sampler.unseen
    of_seen = xy[:, 0] < 3.5
    assert (of_seen.sum(), (~of_seen).sum()) == (8, 12)
    assert set(np.round(xy[of_seen, 0], 2)) <= {1.25, 0.75, 1.75, 3.25}
    colours = {f"colour at ({x:.2f}, {y:.2f})" for x, y in xy[~of_seen]}
    assert unseen == {"n_edges", "total_length", "log_prior"} | colours


def test_probes_lie_in_the_middle_of_sixteen_parts() -> None:
    target = Target(ROOM, 0.2, execution=Execution(resolution=0.5))
    sampler = Ensemble(target, spawn_generators(1, 1))
    xy = sampler.probe_xy
    assert len(xy) == 16
    middle = np.array([1.25, 3.75, 6.25, 8.75])
    assert np.abs(np.unique(xy[:, 0]) - middle).max() <= 0.25
    assert np.abs(np.unique(xy[:, 1]) - middle).max() <= 0.25
    assert len(probe_pixels(Target(ROOM, 0.2, execution=Execution(resolution=8.0)))) <= 4
    assert UNEVEN.contains(xy_of(Target(UNEVEN, 0.5, execution=Execution(resolution=1.0)))).all()


def xy_of(target: Target) -> np.ndarray:
    sampler = Ensemble(target, spawn_generators(1, 1))
    return sampler.probe_xy


def test_outcomes_add_up_over_chains(four: Ensemble) -> None:
    outcomes = four.outcomes()
    assert outcomes.shape == (len(c.MOVES), c.N_OUTCOMES) == (c.N_MOVES, 3)
    assert outcomes[:, c.PROPOSED].sum() == 4 * four.step
    assert (outcomes[:, c.ACCEPTED] <= outcomes[:, c.VALID]).all()
    assert (outcomes[:, c.VALID] <= outcomes[:, c.PROPOSED]).all()


def test_agreement_is_of_functionals_and_probes(four: Ensemble) -> None:
    diagnoses = four.diagnose()
    assert set(FUNCTIONALS) <= set(diagnoses)
    assert sum(name.startswith("colour at (") for name in diagnoses) == len(four.probe_xy)
    assert four.log_posterior() == pytest.approx(
        np.mean([chain.chain.graph.sums[[c.LOG_PRIOR, c.LOG_LIKELIHOOD]].sum() for chain in four.chains])
    )


def test_an_error_in_a_chain_is_raised(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    sampler = Ensemble(Target(ROOM, 0.2, world.data, execution=Execution(resolution=0.5)), spawn_generators(7, 2))
    monkeypatch.setattr(prf.sampler.chain, "recompute_sums", None)
    with pytest.raises(TypeError):
        advance(sampler)
