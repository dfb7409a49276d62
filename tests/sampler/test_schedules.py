"""Steps in a region: what lies outside stays, what follows from the map holds, and targets follow what is in doubt."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.coloring import Coloring, violations
from prf.model.layout import read_coloring
from prf.model.window import Window
from prf.sampler import Ensemble, schedules
from prf.sampler.aims import EVEN, NEVER, aim, target_of_beams, unexplained
from prf.sampler.chain import ChainRun
from prf.sampler.schedules import TURN, TURNS, WHOLE, Regions, has_regions
from prf.sampler.target import Execution, Target, make_chain, run_chain
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance, find_starts, run_to
from tests.reference.beams import Sensor
from tests.reference.recompute import differences
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 16.0, 16.0)
NO_PROBES = np.zeros(0, np.int64)


@pytest.fixture(scope="module")
def target() -> Target:
    found = draw_world(0.25, ROOM, Sensor(8.0), 4, 60, np.random.default_rng(8))
    return Target(ROOM, 0.25, found.data, execution=Execution(resolution=0.5))


def points_of(coloring: Coloring) -> set[tuple[float, float]]:
    return {(x, y) for x, y in coloring.xy.tolist()}


def outside(coloring: Coloring, box: np.ndarray) -> set[tuple[float, float]]:
    return {(x, y) for x, y in points_of(coloring) if not (box[0] < x < box[2] and box[1] < y < box[3])}


def test_what_lies_outside_of_a_region_stays(target: Target) -> None:
    rng = np.random.default_rng(3)
    chain = run_chain(make_chain(target, Coloring.empty(ROOM)), rng, 30_000)
    regions, changed = Regions(chain), 0
    for square in range(0, len(chain.targets.cell), 12):
        tuning, before = regions.tuning(chain, square), read_coloring(chain.graph)
        chain = regions.run_in_region(chain, rng, int(chain.graph.counts[c.STEP]) + TURN, square)
        after = read_coloring(chain.graph)
        box = tuning[c.REGION : c.REGION + 4]
        assert outside(before, box) == outside(after, box)
        assert differences(chain) == []
        assert not violations(after)
        changed += points_of(before) != points_of(after)
    assert changed > 3


def test_turns_depend_on_the_step_alone(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever stops between two turns finds the same map as who does not."""
    monkeypatch.setattr(schedules, "WHOLE", TURN)
    ends = []
    for stops in ([TURN * TURNS * 2], range(TURN, TURN * TURNS * 2 + 1, TURN)):
        rng, chain = np.random.default_rng(5), make_chain(target, Coloring.empty(ROOM))
        regions = Regions(chain)
        for stop in stops:
            chain = run_to(regions, chain, rng, stop)
        ends.append(read_coloring(chain.graph))
    assert np.array_equal(ends[0].xy, ends[1].xy)


def test_where_there_are_no_regions(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schedules, "WHOLE", WHOLE)
    chain = make_chain(target, Coloring.empty(ROOM))
    regions = Regions(chain)
    assert regions.turn(0, 10 * WHOLE, 0) == (run_chain, WHOLE)
    assert regions.turn(WHOLE + TURN, 10 * WHOLE, 0) == (regions.run_in_region, WHOLE + 2 * TURN)
    again = Regions(chain, stands=True)
    assert again.turn(TURN, 10 * WHOLE, 0) == (again.run_in_region, 2 * TURN)
    assert has_regions(target, chain)
    assert not has_regions(target.with_execution(tiles=4), chain)
    bare = dataclasses.replace(target, laser=None)
    assert not has_regions(bare, make_chain(bare, Coloring.empty(ROOM)))


def test_targets_follow_what_chains_left_in_doubt(target: Target) -> None:
    """One return explained at half of the looks, one never, one always, of each of two chains."""
    runs = [ChainRun(target, np.random.default_rng(k), NO_PROBES) for k in range(2)]
    chains = [run.chain for run in runs]
    of_target = target_of_beams(chains[0])
    alone = np.flatnonzero(np.bincount(of_target[of_target != c.NONE]) == 1)
    half, never = (int(np.flatnonzero(of_target == square)[0]) for square in alone[:2])
    for run, noted in zip(runs, (4.0, 0.0), strict=True):
        run.n_looks, run.n_unexplained[half], run.n_unexplained[never] = 4.0, noted, 4.0
    aim(runs)
    share = np.diff(chains[0].targets.cumulative, prepend=0.0)
    n, weights = len(share), {half: 0.25 + 0.5 * NEVER, never: NEVER}
    expected = np.full(n, EVEN / n)
    for beam, weight in weights.items():
        expected[of_target[beam]] += (1.0 - EVEN) * weight / sum(weights.values())
    assert share == pytest.approx(expected, rel=1e-12)
    assert np.array_equal(chains[1].targets.cumulative, chains[0].targets.cumulative)
    assert [run.n_looks for run in runs] == [2.0, 2.0]


def test_unexplained_returns_are_those_behind_no_wall(target: Target) -> None:
    chain = make_chain(target, Coloring.empty(ROOM))
    assert target.laser is not None
    returned = np.isfinite(chain.beams.ray[:, c.RANGE]) & (chain.beams.ray[:, c.RANGE] >= 0.0)
    assert np.array_equal(unexplained(chain), returned)
    sampler = ChainRun(target, np.random.default_rng(6), NO_PROBES, starts_from="grid")
    sampler.find_start(math.inf, lambda: False)
    for _ in range(5):
        sampler.advance()
    assert 0 < unexplained(sampler.chain).sum() < 0.3 * returned.sum()


def test_all_chains_aim_alike_after_blocks_of_powers_of_two(target: Target) -> None:
    sampler = Ensemble(target, spawn_generators(1, 2), starts_from="grid")
    find_starts(sampler)
    first = sampler.chains[0].chain.targets.cumulative.copy()
    seen = []
    for _ in range(4):
        advance(sampler)
        seen.append(sampler.chains[0].chain.targets.cumulative.copy())
    assert np.array_equal(*(chain.chain.targets.cumulative for chain in sampler.chains))
    changed = [not np.array_equal(a, b) for a, b in zip([first, *seen], seen, strict=False)]
    assert changed == [True, True, False, True]
