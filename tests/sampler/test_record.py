"""Draws kept and thinned, burn-in, and the image's times against the average of rasterised maps over every step."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import prf.sampler.chain
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.model.coloring import Coloring, black_at
from prf.model.layout import pixel_centres, read_coloring
from prf.model.window import Window
from prf.sampler import ChainRun
from prf.sampler.chain import FIRST_EPOCH, FIRST_THIN, Draw, Record, burn_in, named_values
from prf.sampler.target import Execution, Target
from tests.driving import step_to
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest
from tests.reference.recompute import differences
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
PROBES = np.array([5, 77, 200])


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.2, ROOM, Sensor(6.0), 2, 30, np.random.default_rng(1))


def make_sampler(world: World, seed: int = 1, resolution: float = 0.5) -> ChainRun:
    return ChainRun(
        Target(ROOM, 0.2, world.data, execution=Execution(resolution=resolution)), np.random.default_rng(seed), PROBES
    )


def shrink(monkeypatch: pytest.MonkeyPatch, thin: int, block: int) -> None:
    """Let everything that happens at steps happen early."""
    monkeypatch.setattr(prf.sampler.chain, "FIRST_THIN", thin)
    monkeypatch.setattr(prf.sampler.chain, "FIRST_EPOCH", thin)
    monkeypatch.setattr(prf.sampler.chain, "SHORTEST_BLOCK", block)


def test_the_burn_in_by_hand() -> None:
    steps = [0, 1, FIRST_EPOCH, 2 * FIRST_EPOCH - 1, 2 * FIRST_EPOCH, 4 * FIRST_EPOCH - 1, 4 * FIRST_EPOCH]
    assert [burn_in(step) for step in steps] == [0, 0, 0, 0, FIRST_EPOCH, FIRST_EPOCH, 2 * FIRST_EPOCH]


@given(st.integers(2 * FIRST_EPOCH, 10**13))
def test_the_burn_in_is_a_quarter_to_a_half(step: int) -> None:
    assert 0.25 * step < burn_in(step) <= 0.5 * step
    assert burn_in(step) % FIRST_EPOCH == 0
    assert burn_in(step) <= burn_in(step + 1)


@given(st.lists(st.integers(1, 5000), max_size=60))
def test_epochs_begin_where_the_burn_in_says(gaps: list[int]) -> None:
    """Whenever one asks on the way, the image leaves out just the burn-in."""
    coloring = Coloring.empty(ROOM)
    image = ChainRun(
        Target(ROOM, 0.2, execution=Execution(resolution=5.0)), np.random.default_rng(), np.zeros(0, int), coloring
    ).chain.image
    times, step = Record(PROBES, image.black.size), 0
    image.black[:] = 1
    for gap in gaps:
        while step + gap >= times.next_start:
            gap -= times.next_start - step
            step = times.next_start
            times.rotate(image, step)
        step += gap
        black, mixed = times.times(image, step)
        assert times.previous_start == burn_in(step)
        assert (black == step - burn_in(step)).all()
        assert (mixed == black).all()


def draw_at(step: int, log_posterior: float = 0.0) -> Draw:
    return Draw(step, Coloring.empty(ROOM), np.array([0.0, 0.0, 0.0, 0.0, log_posterior]), np.zeros(3, bool))


@pytest.mark.parametrize("most", [2, 8, 10])
def test_draws_are_thinned_evenly_up_to_the_cap(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    monkeypatch.setattr(prf.sampler.chain, "MOST_DRAWS", most)
    record = Record(PROBES)
    step = 0
    for _ in range(200):
        step += record.thin - step % record.thin
        record.add(draw_at(step))
        assert len(record.draws) < most
        kept = [draw.step for draw in record.draws]
        assert kept == list(range(record.thin, step + 1, record.thin))
    assert record.thin > FIRST_THIN
    assert record.thin % FIRST_THIN == 0


def test_only_steps_to_record_are_recorded(world: World) -> None:
    sampler = make_sampler(world)
    for step in (1999, 2000, 2001, 4000):
        step_to(sampler, step)
        sampler.record.take(sampler.chain)
    assert [draw.step for draw in sampler.record.draws] == [2000, 4000]
    assert [draw.step for draw in sampler.record.since(2000)] == [4000]
    assert sampler.record.since(4000) == []


def test_a_draw_holds_the_state_at_its_step(world: World) -> None:
    sampler = make_sampler(world)
    step_to(sampler, 2000)
    sampler.record.take(sampler.chain)
    (draw,) = sampler.record.draws
    found = named_values(draw.functionals, sampler.target)
    graph, coloring = sampler.chain.graph, read_coloring(sampler.chain.graph)
    assert np.array_equal(draw.coloring.xy, coloring.xy)
    assert found["n_edges"] == coloring.n_edges
    assert found["total_length"] == pytest.approx(coloring.total_length())
    assert found["log_prior"] == graph.sums[c.LOG_PRIOR]
    assert found["log_likelihood"] == graph.sums[c.LOG_LIKELIHOOD]
    assert found["log_posterior"] == found["log_prior"] + found["log_likelihood"]
    assert draw.probe_black.tolist() == black_at(coloring, pixel_centres(sampler.chain.image.grid)[PROBES]).tolist()
    before = draw.coloring.xy.copy(), draw.functionals.copy(), draw.probe_black.copy()
    step_to(sampler, 30_000)
    assert all(map(np.array_equal, before, (draw.coloring.xy, draw.functionals, draw.probe_black)))


def test_the_best_is_the_highest_ever_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that was thinned out."""
    monkeypatch.setattr(prf.sampler.chain, "MOST_DRAWS", 4)
    record = Record(PROBES)
    assert record.best is None
    heights = np.random.default_rng(2).normal(size=50)
    step = 0
    for k, height in enumerate(heights):
        step += record.thin - step % record.thin
        record.add(draw_at(step, height))
        assert record.best.functionals[-1] == heights[: k + 1].max()


def test_the_chain_records_at_its_spacing_across_blocks(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    shrink(monkeypatch, 40, 200)
    monkeypatch.setattr(prf.sampler.chain, "MOST_DRAWS", 16)
    sampler = make_sampler(world)
    for block in range(1, 21):
        sampler.advance()
        assert sampler.step == 200 * block
        thin = sampler.record.thin
        assert [draw.step for draw in sampler.record.draws] == list(range(thin, sampler.step + 1, thin))
        assert sampler.record.previous_start == burn_in(sampler.step)
    assert sampler.record.thin >= 320


def rasterised(coloring: Coloring, centres: np.ndarray, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Black centres, and squares that are not completely white, by shapely."""
    black = black_at(coloring, centres)
    edges = shapely.MultiLineString(list(coloring.xy[coloring.edges]))
    squares = shapely.box(*(centres - half).T, *(centres + half).T)
    return black, black | shapely.intersects(squares, edges)


@pytest.mark.parametrize("n_blocks", [1, 5, pytest.param(9, marks=pytest.mark.slow)])
def test_the_image_is_the_average_over_every_step(world: World, monkeypatch: pytest.MonkeyPatch, n_blocks: int) -> None:
    shrink(monkeypatch, 40, 100)
    target = Target(ROOM, 0.2, world.data, execution=Execution(resolution=0.5))
    sampler, twin = (ChainRun(target, np.random.default_rng(5), PROBES, world.coloring) for _ in range(2))
    sampler.ground = None
    steps = 100 * n_blocks
    centres, half = pixel_centres(sampler.chain.image.grid), 0.25
    first = burn_in(steps)
    black, mixed = np.zeros((2, len(centres)), np.int64)
    for step in range(steps):
        if step >= first:
            found = rasterised(read_coloring(twin.chain.graph), centres, half)
            black += found[0]
            mixed += found[1]
        step_to(twin, step + 1)
        if (step + 1) % 100 == 0:
            recompute_sums(twin.chain)
    for _ in range(n_blocks):
        sampler.advance()
    totals = sampler.record.times(sampler.chain.image, steps)
    assert np.array_equal(totals[0], black)
    assert np.array_equal(totals[1], mixed)
    assert 0 < black.max() <= steps - first
    assert ((black > 0) & (black < steps - first)).any()
    assert mixed.sum() > black.sum()


def test_laying_out_anew_changes_orders_and_roundings_alone(world: World) -> None:
    """Map, sets, impacts, image and generator stay; sums change in their last bits, lists in their order."""
    sampler = make_sampler(world, seed=4)
    for step in range(2000, 40_001, 2000):
        step_to(sampler, step)
        chain = sampler.chain
        before, sums = digest(chain, sampler.rng), chain.graph.sums.copy()
        beams, impacts = chain.beams.ray.copy(), chain.beams.impact_edge.copy()
        recompute_sums(chain)
        after = digest(chain, sampler.rng)
        assert {name for name in before if before[name] != after[name]} <= {"sums", "beams", "index"}
        assert chain.graph.sums == pytest.approx(sums, rel=1e-10, abs=1e-9)
        assert np.array_equal(chain.beams.ray, beams)
        assert np.array_equal(chain.beams.impact_edge, impacts)
        assert differences(chain) == []
        again = digest(chain, sampler.rng)
        recompute_sums(chain)
        assert digest(chain, sampler.rng) == again
    assert chain.graph.counts[c.EDGES] > 4


def test_blocks_grow_with_the_beams() -> None:
    lengths = [prf.sampler.chain.block_length(n) for n in (0, 10_000, 10_001, 40_000, 1_000_000)]
    assert lengths == [10_000, 10_000, 20_000, 40_000, 40_000]
