"""Rounds of tiles keep the joint law of maps and readings, and the laws of the prior; negative controls do not."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import prf.sampler.tiles.part as part
import prf.sampler.tiles.rounds as rounds
from prf.kernels.state.chain import Chain
from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.model.window import Window
from prf.sampler.target import Execution, Target
from prf.sampler.tiles.rounds import Round, TileData
from tests.statistical import mutants, tiled
from tests.statistical.joint import changes, z_of_changes
from tests.statistical.laws import law_scores
from tests.statistical.means import largest

SEED = 20050726
N_DRAWS, BATCH = 2000, 20
LIMIT = 4.0
"""Some 22 numbers, not all independent: beyond it by chance once in 700."""


def worst_change(n: int, with_sonar: bool = False, start: tiled.Begin = tiled.begin) -> float:
    """Largest |z| of the mean change of a value, trials in two threads."""
    change = partial(tiled.round_change, with_sonar=with_sonar, start=start)
    with ThreadPoolExecutor(2) as pool:
        halves = pool.map(lambda k: changes(change, n // 2, SEED + k), range(2))
        z = z_of_changes(np.concatenate(list(halves)))
    print(dict(zip(tiled.NAMES, z.round(2).tolist(), strict=False)))
    return float(np.abs(z).max())


@pytest.mark.slow
def test_a_round_changes_no_mean_in_a_few_worlds() -> None:
    found = changes(tiled.round_change, 40, SEED)
    assert (found[:, 0] != 0).mean() > 0.9
    assert np.abs(z_of_changes(found)).max() < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("with_sonar", [False, True], ids=["laser", "laser, sonar and points"])
def test_a_round_keeps_the_joint_law_of_maps_and_readings(with_sonar: bool) -> None:
    assert worst_change(1200, with_sonar) < LIMIT


@pytest.mark.slow
def test_beams_without_guards_are_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    share = part.share_beams

    def careless(data: TileData, begun: Round, number: int) -> part.Shared:
        found = share(data, begun, number)
        return found._replace(guards=found.guards[:0], stops=found.stops[:0])

    monkeypatch.setattr(part, "share_beams", careless)
    assert worst_change(400) > 6.0


@pytest.mark.slow
def test_a_partition_that_looks_at_the_map_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of twelve partitions the one of which most edges lie inside tiles: a sampler that would seem to be quicker."""
    present: dict[int, Coloring] = {}
    draw = rounds.random_tiles

    def greedy(
        window: Window, n: int, returns: np.ndarray, least: float, pixels: Grid, rng: np.random.Generator
    ) -> np.ndarray:
        drawn = [draw(window, n, returns, least, pixels, rng) for _ in range(12)]
        return max(drawn, key=lambda tiles: edges_inside(present[id(rng)], tiles))

    def begin(data: TileData, chain: Chain, rng: np.random.Generator) -> Round:
        present[id(rng)] = read_coloring(chain.graph)
        return tiled.begin(data, chain, rng)

    monkeypatch.setattr(rounds, "random_tiles", greedy)
    assert worst_change(1200, start=begin) > 5.0


def edges_inside(coloring: Coloring, tiles: np.ndarray) -> int:
    ends = coloring.xy[coloring.edges]
    return int(sum(((ends > tile[:2]) & (ends < tile[2:])).all(axis=(1, 2)).sum() for tile in tiles))


@pytest.mark.slow
def test_tiled_chains_obey_the_laws_of_the_prior() -> None:
    target = Target(tiled.ROOM, tiled.SCALE, execution=Execution(resolution=0.5))
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: tiled.tiled_draws(target, N_DRAWS, SEED + k), range(2)))
    ids = np.repeat(np.arange(2), N_DRAWS)
    scores = law_scores(
        Draws.from_colorings([draw for chain in chains for draw in chain]),
        tiled.SCALE,
        tiled.ROOM,
        chain_ids=ids,
        batch=BATCH,
    )
    print(scores.relative_error_edges, scores.worst())
    assert scores.relative_error_edges < 0.006
    # 71 numbers, each beyond 4 by chance once in 11,000 (Student, 200 batches).
    assert not scores.beyond(4.0), scores.worst()


@pytest.mark.slow
@pytest.mark.parametrize(("mutant", "is_right"), [(mutants.INTACT, True), (mutants.WHOLE_AREA, False)])
def test_counts_of_the_whole_window_are_caught(mutant: mutants.Mutant, is_right: bool, tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutant, "tests.statistical.tiled", "1000", str(SEED), compiled=True)
    name, z = largest(found["z"])
    assert z < 4.5 if is_right else z > 6.0, name
