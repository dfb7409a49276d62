"""Steps in a region: what lies outside stays, what follows from the map holds, and targets follow what is in doubt."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.frozen import confine, release
from prf.model.coloring import Coloring, violations
from prf.model.layout import read_coloring, run_chain
from prf.model.window import Window
from prf.sampler import Sampler
from prf.sampler.chain import ChainSampler
from prf.sampler.posterior import Settings, make_chain
from prf.sampler.targets import EVEN, NEVER, TURN, TURNS, Doubts, Focus, aim, focus_of, target_of_beams, unexplained
from prf.shell.cli.provenance import spawn_generators
from tests.reference.beams import Sensor
from tests.reference.recompute import differences
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 16.0, 16.0)
NO_PROBES = np.zeros(0, np.int64)


@pytest.fixture(scope="module")
def settings() -> Settings:
    found = draw_world(0.25, ROOM, Sensor(8.0), 4, 60, np.random.default_rng(8))
    return Settings(ROOM, 0.25, found.data, resolution=0.5)


def points_of(coloring: Coloring) -> set[tuple[float, float]]:
    return {(x, y) for x, y in coloring.xy.tolist()}


def outside(coloring: Coloring, box: np.ndarray) -> set[tuple[float, float]]:
    return {(x, y) for x, y in points_of(coloring) if not (box[0] < x < box[2] and box[1] < y < box[3])}


def test_what_lies_outside_of_a_region_stays(settings: Settings) -> None:
    rng = np.random.default_rng(3)
    chain = run_chain(make_chain(settings, Coloring.empty(ROOM)), rng, 30_000)
    focus, changed = Focus(chain), 0
    for target in range(0, len(chain.targets.cell), 12):
        tuning, before = focus.tuning(chain, target), read_coloring(chain.graph)
        chain = focus.run_in_region(chain, rng, target, int(chain.graph.counts[c.STEP]) + TURN)
        after = read_coloring(chain.graph)
        box = tuning[c.REGION : c.REGION + 4]
        assert outside(before, box) == outside(after, box)
        assert differences(chain) == []
        assert not violations(after)
        changed += points_of(before) != points_of(after)
    assert changed > 3


def test_a_region_gives_back_every_set(settings: Settings) -> None:
    rng = np.random.default_rng(4)
    chain = run_chain(make_chain(settings, Coloring.empty(ROOM)), rng, 30_000)
    before = [set(chain.graph.members[kind, : chain.graph.counts[kind]].tolist()) for kind in range(c.N_SETS)]
    frozen = np.empty(len(chain.graph.edge_length), np.int32)
    n = confine(chain.graph, Focus(chain).tuning(chain, 5), frozen)
    assert 0 < n == len(before[c.EDGES]) - chain.graph.counts[c.EDGES]
    release(chain.graph, frozen, n)
    assert before == [set(chain.graph.members[kind, : chain.graph.counts[kind]].tolist()) for kind in range(c.N_SETS)]


def test_turns_depend_on_the_step_alone(settings: Settings) -> None:
    """Whoever stops between two turns finds the same map as who does not."""
    ends = []
    for stops in ([TURN * TURNS * 2], range(TURN, TURN * TURNS * 2 + 1, TURN)):
        rng, chain = np.random.default_rng(5), make_chain(settings, Coloring.empty(ROOM))
        focus = Focus(chain)
        for stop in stops:
            chain = focus.run_to(chain, rng, stop)
        ends.append(read_coloring(chain.graph))
    assert np.array_equal(ends[0].xy, ends[1].xy)


def test_where_there_are_no_regions(settings: Settings) -> None:
    chain = make_chain(settings, Coloring.empty(ROOM))
    assert focus_of(settings, chain) is not None
    assert focus_of(dataclasses.replace(settings, tiles=4), chain) is None
    bare = dataclasses.replace(settings, laser=None)
    assert focus_of(bare, make_chain(bare, Coloring.empty(ROOM))) is None


def test_targets_follow_what_chains_left_in_doubt(settings: Settings) -> None:
    """One return explained at half of the looks, one never, one always, of each of two chains."""
    chains = [make_chain(settings, Coloring.empty(ROOM)) for _ in range(2)]
    doubts = [Doubts(chain) for chain in chains]
    of_target = target_of_beams(chains[0])
    alone = np.flatnonzero(np.bincount(of_target[of_target != c.NONE]) == 1)
    half, never = (int(np.flatnonzero(of_target == target)[0]) for target in alone[:2])
    for each, noted in zip(doubts, (4.0, 0.0), strict=True):
        each.looks, each.count[half], each.count[never] = 4.0, noted, 4.0
    aim(chains, doubts)
    share = np.diff(chains[0].targets.cumulative, prepend=0.0)
    n, weights = len(share), {half: 0.25 + 0.5 * NEVER, never: NEVER}
    expected = np.full(n, EVEN / n)
    for beam, weight in weights.items():
        expected[of_target[beam]] += (1.0 - EVEN) * weight / sum(weights.values())
    assert share == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(chains[1].targets.cumulative, chains[0].targets.cumulative)
    assert [each.looks for each in doubts] == [2.0, 2.0]


def test_unexplained_returns_are_those_behind_no_wall(settings: Settings) -> None:
    chain = make_chain(settings, Coloring.empty(ROOM))
    assert settings.laser is not None
    returned = np.isfinite(chain.beams.ray[:, c.RANGE]) & (chain.beams.ray[:, c.RANGE] >= 0.0)
    assert np.array_equal(unexplained(chain), returned)
    sampler = ChainSampler(settings, np.random.default_rng(6), NO_PROBES, starts_from="grid")
    sampler.find_start(lambda: False)
    for _ in range(5):
        sampler.advance()
    assert 0 < unexplained(sampler.chain).sum() < 0.3 * returned.sum()


def test_all_chains_aim_alike_after_blocks_of_powers_of_two(settings: Settings) -> None:
    with Sampler(settings, spawn_generators(1, 2), 1, starts_from="grid") as sampler:
        sampler.find_starts(lambda: False)
        first = sampler.chains[0].chain.targets.cumulative.copy()
        seen = []
        for _ in range(4):
            sampler.advance()
            seen.append(sampler.chains[0].chain.targets.cumulative.copy())
        assert np.array_equal(*(chain.chain.targets.cumulative for chain in sampler.chains))
    changed = [not np.array_equal(a, b) for a, b in zip([first, *seen], seen, strict=False)]
    assert changed == [True, True, False, True]
