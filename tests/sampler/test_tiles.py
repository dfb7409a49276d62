"""Tiles: partitions, what belongs to whom, maps put together again, and runs that know nothing of threads."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import prf.sampler.tiles.rounds as schedule
from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.targets import Targets
from prf.model.arak import exact_draws
from prf.model.coloring import violations
from prf.model.layout import image_grid, read_coloring
from prf.model.orientation import Orientation
from prf.model.window import Window
from prf.sampler import Ensemble
from prf.sampler.chain import functionals
from prf.sampler.prepare import chosen_tiles
from prf.sampler.target import Execution, Target, make_chain, run_chain
from prf.sampler.tiles.part import cut_targets, make_part
from prf.sampler.tiles.rounds import Round, TileData, make_round, make_tile_data, random_tiles
from prf.sampler.tiles.schedule import draw_at, finish_round, work_tile
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest, structural_faults
from tests.reference.recompute import differences, recompute_impacts
from tests.reference.slow_points import Flips, lattice, observe
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 12.0, 10.0)
SCALE = 0.25


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(SCALE, ROOM, Sensor(8.0), 6, 40, np.random.default_rng(3))


@pytest.fixture(scope="module")
def target(world: World) -> Target:
    """Laser, sonar and points in one world, with an image."""
    rng = np.random.default_rng(4)
    places = np.unique(world.data.readings.origin, axis=0)
    sonar = draw_data(world.coloring, Ring(max=2.5), ring_all_round(places, 12, 0.4, rng), rng)
    points = observe(world.coloring, Flips(), lattice(12, 0.05, 9.95), rng)
    return Target(ROOM, SCALE, world.data, sonar=sonar, points=points, execution=Execution(resolution=0.5))


class Trial:
    """A chain in a world and the round that it begins."""

    def __init__(self, target: Target, world: World, seed: int, steps: int = 6000) -> None:
        self.data: TileData = make_tile_data(target)
        self.chain: Chain = make_chain(target, world.coloring)
        rng = np.random.default_rng(seed)
        self.begun: Round = make_round(self.data, self.chain, 6, 1.5, steps, rng)

    @property
    def numbers(self) -> range:
        return range(len(self.begun.tiles))

    def finish(self) -> Chain:
        results = [work_tile(self.data, self.begun, number) for number in self.numbers]
        return finish_round(self.data, self.chain, self.begun, results)


@pytest.mark.parametrize("seed", range(5))
def test_tiles_cover_the_window_once(seed: int) -> None:
    rng = np.random.default_rng(seed)
    returns = rng.normal([4.0, 5.0], 1.5, (300, 2))
    tiles = random_tiles(ROOM, 8, returns, 1.0, image_grid(ROOM, 0.25), rng)
    assert len(tiles) == 8
    assert np.isclose(((tiles[:, 2] - tiles[:, 0]) * (tiles[:, 3] - tiles[:, 1])).sum(), ROOM.area)
    points = rng.uniform(ROOM[:2], ROOM[2:], (500, 2))
    inside = [((tile[:2] <= points) & (points < tile[2:])).all(axis=1) for tile in tiles]
    assert (np.sum(inside, axis=0) == 1).all()
    assert np.min(tiles[:, 2:] - tiles[:, :2]) >= 0.75, "a cut may be moved to the next line of pixels"
    assert np.allclose(tiles / 0.25, np.round(tiles / 0.25))


def test_a_window_too_narrow_for_so_many_tiles_has_fewer() -> None:
    tiles = random_tiles(
        ROOM, 50, np.zeros((0, 2)), 4.0, image_grid(ROOM, 1.0)._replace(nx=0), np.random.default_rng(1)
    )
    assert 2 <= len(tiles) <= 6


@pytest.mark.parametrize("seed", range(4))
def test_each_beam_is_decided_by_one_tile(target: Target, world: World, seed: int) -> None:
    trial = Trial(target, world, seed)
    n = len(trial.data.ray)
    before = recompute_impacts(trial.chain)
    owners, distance, likelihood = np.zeros(n, int), np.full(n, np.nan), before.log_likelihood.copy()
    for number in trial.numbers:
        part = make_part(trial.data, trial.begun, number)
        rng = np.random.default_rng(int(trial.begun.seeds[number]))
        chain = run_chain(part.chain, rng, trial.begun.steps)
        owners[part.beams] += 1
        distance[part.beams] = chain.beams.ray[:, c.DISTANCE]
        likelihood[part.beams] = chain.beams.ray[:, c.BEAM_LOG_LIKELIHOOD]
    after = recompute_impacts(trial.finish())
    assert owners.max() == 1
    moved = np.abs(likelihood - before.log_likelihood) > 0
    assert moved.sum() > 5
    assert np.array_equal(likelihood, after.log_likelihood)
    # Beyond its influence a tile need not know where an obstacle stands.
    near = (owners == 1) & (after.distance < trial.data.influence)
    assert near.sum() > 50
    assert np.array_equal(distance[near], after.distance[near])


@pytest.mark.parametrize("seed", range(4))
def test_the_chain_after_a_round_is_what_its_map_says(target: Target, world: World, seed: int) -> None:
    trial = Trial(target, world, seed)
    old = trial.begun.coloring
    step = int(trial.chain.graph.counts[c.STEP])
    chain = trial.finish()
    assert differences(chain) == []
    assert structural_faults(chain) == []
    assert violations(read_coloring(chain.graph)) == []
    assert chain.graph.counts[c.STEP] == step + trial.begun.steps * len(trial.begun.tiles)
    new = {tuple(sorted(ends)) for ends in ends_of(read_coloring(chain.graph))}
    kept = [ends for ends, tile in zip(ends_of(old), trial.begun.edge_tile, strict=True) if tile == c.NONE]
    assert {tuple(sorted(ends)) for ends in kept} <= new
    assert len(new - {tuple(sorted(ends)) for ends in ends_of(old)}) > 3


def ends_of(coloring: object) -> list[list[tuple[float, float]]]:
    return [[(x, y), (u, v)] for x, y, u, v in coloring.segments().tolist()]  # type: ignore[attr-defined]


def test_steps_of_all_tiles_are_counted(target: Target, world: World) -> None:
    trial = Trial(target, world, 5)
    before = trial.chain.image.black.copy()
    chain = trial.finish()
    step = int(chain.graph.counts[c.STEP])
    assert (chain.image.black_time <= step).all()
    assert (chain.image.black_time <= chain.image.mixed_time).all()
    turned = before != chain.image.black
    assert turned.any()
    assert ((chain.image.black_time[turned] > 0) & (chain.image.black_time[turned] < step)).all()
    still = (before == 1) & (chain.image.black_time == step)
    assert still.sum() > 10


def test_a_tile_draws_and_counts_only_what_lies_inside(target: Target, world: World) -> None:
    trial = Trial(target, world, 6)
    for number in trial.numbers:
        part = make_part(trial.data, trial.begun, number)
        graph, box = part.chain.graph, trial.begun.tiles[number]
        drawn = graph.members[c.EDGES, : graph.counts[c.EDGES]]
        assert ((graph.edge_xy[drawn] > box[[0, 1, 0, 1]]) & (graph.edge_xy[drawn] < box[[2, 3, 2, 3]])).all()
        assert sorted(part.drawn) == sorted(set(part.drawn))
        assert (trial.begun.edge_tile[part.drawn] == number).all()
        assert graph.counts[c.BOUNDARY_VERTICES] == 0
        free = graph.members[c.INTERIOR_VERTICES, : graph.counts[c.INTERIOR_VERTICES]]
        assert np.isin(graph.vertex_edges[free], drawn).all()
        assert not np.isin(free, part.pinned).any()


def test_steps_in_the_prior_have_no_readings() -> None:
    target = Target(ROOM, 0.4)
    data = make_tile_data(target)
    chain = make_chain(target, exact_draws(0.4, ROOM, 1, np.random.default_rng(2))[0])
    rng = np.random.default_rng(3)
    for _ in range(3):
        begun = make_round(data, chain, 5, 1.5, 5000, rng)
        chain = finish_round(data, chain, begun, [work_tile(data, begun, k) for k in range(len(begun.tiles))])
        assert differences(chain) == []


@pytest.fixture
def short_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schedule, "ROUND_LENGTHS", (16_000, 32_000))
    monkeypatch.setattr(schedule, "STEPS_PER_READING", 100)


def run_tiled(target: Target, threads: int, rounds: int) -> Ensemble:
    sampler = Ensemble(target.with_execution(tiles=5), spawn_generators(7, 2), threads=threads)
    while sampler.step < rounds * 32_000:
        advance(sampler, threads)
    return sampler


@pytest.mark.usefixtures("short_rounds")
def test_threads_change_no_result(target: Target) -> None:
    one, two, three = (run_tiled(target, threads, 3) for threads in (1, 2, 3))
    for other in (two, three):
        for a, b in zip(one.chains, other.chains, strict=True):
            assert digest(a.chain, a.rng) == digest(b.chain, b.rng)
            assert [draw.step for draw in a.record.draws] == [draw.step for draw in b.record.draws]
    assert one.step == 96_000
    assert [draw.step for draw in one.chains[0].record.draws][-5:] == [64_000, 72_000, 80_000, 88_000, 96_000]
    assert all(np.array_equal(x, y, equal_nan=True) for x, y in zip(one.occupancy(), three.occupancy(), strict=True))
    assert np.nanmax(one.occupancy()[1]) <= 1.0


@pytest.mark.parametrize("is_building", [False, True], ids=["plain", "directions and free space"])
def test_draws_within_a_round_are_what_their_maps_say(target: Target, world: World, is_building: bool) -> None:
    if is_building:
        target = dataclasses.replace(target, orientation=Orientation(1.5, 0.3), free_space=0.4)
    probes = np.arange(0, 480, 7)
    trial = Trial(target, world, 6)
    begun = make_round(trial.data, trial.chain, 6, 1.5, 6000, np.random.default_rng(6), 3, probes)
    at_first = functionals(trial.chain)
    results = [work_tile(trial.data, begun, number) for number in range(6)]
    draws = [draw_at(begun, results, look, 1000 * look, at_first) for look in range(3)]
    for draw in draws:
        chain = make_chain(target, draw.coloring)
        assert violations(draw.coloring) == []
        np.testing.assert_allclose(draw.functionals, functionals(chain), rtol=1e-9)
        assert np.array_equal(draw.probe_black, chain.image.black[probes])
    assert len({draw.functionals[-1] for draw in draws}) == 3
    last = finish_round(trial.data, trial.chain, begun, results)
    np.testing.assert_allclose(draws[-1].functionals, functionals(last), rtol=1e-9)


def test_looks_change_no_result(target: Target, world: World) -> None:
    maps = []
    for looks in (1, 4):
        trial = Trial(target, world, 7)
        begun = make_round(trial.data, trial.chain, 6, 1.5, 6000, np.random.default_rng(7), looks)
        results = [work_tile(trial.data, begun, number) for number in range(6)]
        maps.append(finish_round(trial.data, trial.chain, begun, results).graph)
    assert all(np.array_equal(a, b) for a, b in zip(*maps, strict=True))


def test_a_beam_has_no_influence_beyond_its_own(target: Target) -> None:
    data = make_tile_data(target)
    assert (data.influence <= data.ray[:, c.MAX_DISTANCE]).all()
    chain = make_chain(target, exact_draws(SCALE, ROOM, 1, np.random.default_rng(2))[0]._replace(anchor_black=False))
    found = recompute_impacts(chain)
    beyond = (found.distance > data.influence) & (found.distance < data.ray[:, c.MAX_DISTANCE])
    assert beyond.sum() > 3
    returned = np.isfinite(data.ray[:, c.RANGE])
    assert returned[beyond].all()
    assert (found.log_likelihood[beyond] == chain.beams.model[c.LOG_OUTLIER]).all()


def test_windows_that_are_large_and_full_have_tiles() -> None:
    assert chosen_tiles(Window(0.0, 0.0, 50.0, 50.0), 10**6) == 0
    assert chosen_tiles(Window(0.0, 0.0, 200.0, 200.0), 100) == 0
    assert chosen_tiles(Window(0.0, 0.0, 200.0, 200.0), 10**5) > 4


def test_targets_of_a_tile_are_those_of_the_window_in_it(target: Target) -> None:
    data = make_tile_data(target)
    tile = Window(2.3, 1.9, 7.4, 8.8)
    whole, part = data.targets, cut_targets(data.targets, tile)

    def middles(targets: Targets, numbers: np.ndarray) -> set[tuple[float, float]]:
        grid, cell = targets.grid, targets.cell[numbers]
        x, y = grid.x0 + (cell % grid.nx) * grid.cell, grid.y0 + (cell // grid.nx) * grid.cell
        return {(round(a, 6), round(b, 6)) for a, b in zip(x.tolist(), y.tolist(), strict=True)}

    def near(targets: Targets, number: int) -> np.ndarray:
        return targets.near[targets.near_start[number] : targets.near_start[number + 1]]

    inside = middles(part, np.arange(len(part.cell)))
    assert 10 < len(inside) < len(whole.cell)
    assert inside <= middles(whole, np.arange(len(whole.cell)))
    for k in range(len(part.cell)):
        assert part.number[part.cell[k]] == k
        (twin,) = (i for i in range(len(whole.cell)) if middles(whole, np.array([i])) == middles(part, np.array([k])))
        assert middles(part, near(part, k)) == middles(whole, near(whole, twin)) & inside
