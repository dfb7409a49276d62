"""Arrays of a chain: laid out for any map, read back as they were, grown without a trace in what the chain does."""

from __future__ import annotations

import numpy as np
import pytest

import prf.sampler.target
from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring
from prf.model.layout import grow, lengthen, make_graph, read_coloring
from prf.model.window import INTERIOR, Window
from prf.sampler.target import Execution, Target, make_chain
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest, structural_faults
from tests.reference.recompute import differences
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.3, ROOM, Sensor(6.0), 2, 40, np.random.default_rng(1))


def start_chain(world: World, from_truth: bool) -> Chain:
    start = world.coloring if from_truth else Coloring.empty(ROOM)
    return make_chain(Target(ROOM, 0.3, world.data, execution=Execution(resolution=0.5, cell=1.0)), start)


def edge_set(coloring: Coloring) -> set[frozenset[tuple[float, ...]]]:
    points = [tuple(xy) for xy in coloring.xy.tolist()]
    return {frozenset((points[a], points[b])) for a, b in coloring.edges.tolist()}


def test_a_coloring_is_read_back_as_it_was() -> None:
    for coloring in [*exact_draws(0.5, ROOM, 5, np.random.default_rng(2)), Coloring.empty(ROOM, black=True)]:
        found = read_coloring(make_graph(coloring, 2 * coloring.n_vertices + 8))
        assert edge_set(found) == edge_set(coloring)
        assert found.window == coloring.window
        assert found.anchor_black == coloring.anchor_black
        by_place = {tuple(xy): side for xy, side in zip(coloring.xy.tolist(), coloring.side.tolist(), strict=True)}
        assert {tuple(xy): side for xy, side in zip(found.xy.tolist(), found.side.tolist(), strict=True)} == by_place
        assert found.side.dtype == coloring.side.dtype
        assert found.edges.dtype == coloring.edges.dtype
        assert (found.side == INTERIOR).sum() == (coloring.side == INTERIOR).sum()


def test_reading_a_chain_gives_a_copy(world: World) -> None:
    chain = start_chain(world, from_truth=True)
    coloring = read_coloring(chain.graph)
    before = coloring.xy.copy(), coloring.edges.copy()
    run(chain, np.random.default_rng(3), 20_000)
    assert np.array_equal(coloring.xy, before[0])
    assert np.array_equal(coloring.edges, before[1])


def test_lengthening_keeps_what_is_there() -> None:
    longer = lengthen(np.arange(6).reshape(2, 3), 1, 5, -1)
    assert longer.tolist() == [[0, 1, 2, -1, -1], [3, 4, 5, -1, -1]]
    assert lengthen(np.arange(2.0), 0, 3, 0).dtype == np.float64


def test_growing_changes_no_state(world: World) -> None:
    chain, rng = start_chain(world, from_truth=True), np.random.default_rng(4)
    run(chain, rng, 5000)
    before = digest(chain, rng)
    for _ in range(3):
        chain = grow(chain)
        assert digest(chain, rng) == before
        assert differences(chain) == structural_faults(chain) == []


def run_grown(chain: Chain, rng: np.random.Generator, until: int, every: int) -> tuple[Chain, int]:
    """Run, growing where the kernel needs it and looking at the twins in between; return how often it grew."""
    n_grown = 0
    for step in range(every, until + 1, every):
        while not run(chain, rng, step):
            chain = grow(chain)
            n_grown += 1
            assert differences(chain) == structural_faults(chain) == []
        assert differences(chain) == structural_faults(chain) == []
    return chain, n_grown


def test_a_chain_short_of_room_does_as_one_with_plenty(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit: when an array grows depends on chance, so it must leave no trace."""
    results = []
    for capacity, room in ((4096, 256), (2 * c.MOST_CHANGES, c.MOST_CHANGES)):
        monkeypatch.setattr(prf.sampler.target, "FIRST_CAPACITY", capacity)
        monkeypatch.setattr(prf.sampler.target, "FIRST_CELL_ROOM", room)
        rng = np.random.default_rng(5)
        chain, n_grown = run_grown(start_chain(world, from_truth=False), rng, 20_000, 200)
        results.append((digest(chain, rng), n_grown))
    assert results[0][0] == results[1][0]
    assert results[0][1] == 0 < results[1][1]


def test_a_chain_of_many_edges_grows_from_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prf.sampler.target, "FIRST_CAPACITY", 1)
    monkeypatch.setattr(prf.sampler.target, "FIRST_CELL_ROOM", c.MOST_CHANGES)
    chain = make_chain(Target(ROOM, 1.0, execution=Execution(resolution=1.0)), Coloring.empty(ROOM))
    chain, n_grown = run_grown(chain, np.random.default_rng(6), 120_000, 10_000)
    assert chain.graph.counts[c.EDGES] > 300
    assert n_grown >= 4


def test_a_crowded_map_gets_the_room_it_needs() -> None:
    """A start with more edges a cell than the first room holds."""
    coloring = exact_draws(12.0, Window(0.0, 0.0, 1.0, 1.0), 1, np.random.default_rng(7))[0]
    chain = make_chain(Target(coloring.window, 12.0, execution=Execution(cell=1.0)), coloring)
    assert chain.edge_index.cell_count.max() > prf.sampler.target.FIRST_CELL_ROOM
    assert differences(chain) == structural_faults(chain) == []
    run(chain, np.random.default_rng(8), 2000)
    assert differences(chain) == structural_faults(chain) == []
