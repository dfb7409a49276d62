"""Chains in tiles sample what chains without them do; negative controls show that the checks would see it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import prf.sampler.tiles.part as part
import prf.sampler.tiles.rounds as rounds
import prf.sampler.tiles.schedule as schedule
from prf.coloring import Coloring, Draws, black_at_draws
from prf.kernels import constants as c
from prf.kernels.build import resum
from prf.kernels.chain import Chain
from prf.kernels.grid import Grid
from prf.kernels.step import run
from prf.layout import grow, read_coloring
from prf.posterior import Settings, make_chain
from prf.sampler.tiles import Round, TileData
from prf.window import Window
from tests.reference.beams import Sensor
from tests.reference.worlds import draw_world
from tests.statistical import mutants, tiled
from tests.statistical.laws import law_scores
from tests.statistical.test_calibration import STAGES, report, run_worlds

SEED = 20050726
HALL = Window(0.0, 0.0, 12.0, 10.0)
N_DRAWS, BATCH = 2000, 20
N_POSTERIOR = 800
LIMIT = 4.0

pytestmark = pytest.mark.slow


def worst(z: dict[str, float]) -> list[tuple[str, float]]:
    return sorted(z.items(), key=lambda item: -abs(item[1]))[:5]


def test_tiled_chains_obey_the_laws_of_the_prior() -> None:
    settings = Settings(tiled.ROOM, tiled.SCALE, resolution=0.5)
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: tiled.tiled_draws(settings, N_DRAWS, SEED + k)[0], range(2)))
    ids = np.repeat(np.arange(2), N_DRAWS)
    scores = law_scores(Draws.concatenate(chains), tiled.SCALE, tiled.ROOM, chain_ids=ids, batch=BATCH)
    print(scores.relative_error_edges, worst(scores.z))
    assert scores.relative_error_edges < 0.006
    # 71 numbers, each beyond 4 by chance once in 11,000 (Student, 200 batches).
    assert not scores.beyond(LIMIT), worst(scores.z)


def test_a_partition_that_looks_at_the_map_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of twelve partitions the one of which most edges lie inside tiles: a sampler that would seem to be quicker."""
    present: dict[str, Coloring] = {}
    draw = rounds.random_tiles

    def greedy(
        window: Window, n: int, returns: np.ndarray, least: float, pixels: Grid, rng: np.random.Generator
    ) -> np.ndarray:
        drawn = [draw(window, n, returns, least, pixels, rng) for _ in range(12)]
        return max(drawn, key=lambda tiles: edges_inside(present["map"], tiles))

    def begin(data: TileData, chain: Chain, rng: np.random.Generator) -> Round:
        present["map"] = read_coloring(chain.graph)
        return tiled.begin(data, chain, rng)

    monkeypatch.setattr(rounds, "random_tiles", greedy)
    draws, _ = tiled.tiled_draws(Settings(tiled.ROOM, tiled.SCALE), 1000, SEED, begin)
    scores = law_scores(draws, tiled.SCALE, tiled.ROOM, batch=BATCH)
    print(worst(scores.z))
    assert abs(worst(scores.z)[0][1]) > 6.0, worst(scores.z)


def edges_inside(coloring: Coloring, tiles: np.ndarray) -> int:
    ends = coloring.xy[coloring.edges]
    return int(sum(((ends > tile[:2]) & (ends < tile[2:])).all(axis=(1, 2)).sum() for tile in tiles))


@pytest.mark.parametrize(("mutant", "is_right"), [(mutants.INTACT, True), (mutants.WHOLE_AREA, False)])
def test_counts_of_the_whole_window_are_caught(mutant: mutants.Mutant, is_right: bool, tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutant, "tests.statistical.tiled", "1000", str(SEED), compiled=True)
    z = abs(worst(found["z"])[0][1])
    assert z < 4.5 if is_right else z > 6.0, worst(found["z"])


def hall() -> Settings:
    world = draw_world(0.25, HALL, Sensor(8.0), 4, 24, np.random.default_rng(3))
    return Settings(HALL, 0.25, world.data)


def untiled_draws(settings: Settings, n_draws: int, seed: int) -> tuple[Draws, np.ndarray]:
    """As :func:`tests.statistical.tiled.tiled_draws`, as many steps on the whole window."""
    rng, chain = np.random.default_rng(seed), make_chain(settings, Coloring.empty(settings.window))
    maps, sums = [], []
    for number in range(tiled.BURN_IN + n_draws):
        until = (number + 1) * (tiled.STEPS + tiled.PLAIN)
        while not run(chain, rng, until):
            chain = grow(chain)
        resum(chain)
        if number >= tiled.BURN_IN:
            maps.append(read_coloring(chain.graph))
            sums.append(chain.graph.sums[[c.LOG_PRIOR, c.LOG_LIKELIHOOD]])
    return Draws.from_colorings(maps, settings.window), np.array(sums)


def batch_means(draws: Draws, sums: np.ndarray) -> np.ndarray:
    """Means over batches of 40 draws: edges, length, log prior, log likelihood, colours of 30 points."""
    points = np.random.default_rng(0).uniform(HALL[:2], HALL[2:], (30, 2))
    values = np.column_stack([draws.n_edges, draws.total_length(), sums, black_at_draws(draws, points)])
    return values[: len(values) // 40 * 40].reshape(-1, 40, values.shape[1]).mean(axis=1)


def differences_of_means(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """z-score of each mean of one sampler against that of the other; a colour that never changes has none."""
    error = np.sqrt(sum(means.var(axis=0, ddof=1) / len(means) for means in (one, two)))
    return np.divide(one.mean(axis=0) - two.mean(axis=0), error, out=np.zeros(len(error)), where=error > 0.0)


def sampled(tiles: bool, seeds: range) -> np.ndarray:
    sampler = tiled.tiled_draws if tiles else untiled_draws
    with ThreadPoolExecutor(2) as pool:
        return np.concatenate(list(pool.map(lambda seed: batch_means(*sampler(hall(), N_POSTERIOR, seed)), seeds)))


@pytest.fixture(scope="module")
def without_tiles() -> np.ndarray:
    return sampled(False, range(4))


def test_the_posterior_is_that_of_a_chain_without_tiles(without_tiles: np.ndarray) -> None:
    z = differences_of_means(sampled(True, range(4)), without_tiles)
    print(z.round(2))
    assert np.abs(z).max() < LIMIT, z.round(2)


def test_beams_without_guards_are_caught(without_tiles: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    share = part.share_beams

    def careless(data: TileData, begun: Round, number: int) -> part.Shared:
        found = share(data, begun, number)
        return found._replace(guards=found.guards[:0], stops=found.stops[:0])

    monkeypatch.setattr(part, "share_beams", careless)
    z = differences_of_means(sampled(True, range(2)), without_tiles)
    print(z.round(2))
    assert np.abs(z).max() > 6.0, z.round(2)


def test_probabilities_are_the_shares_observed_with_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(schedule, "ROUND_LENGTHS", (64_000, 64_000))
    found, answers = run_worlds(30, STAGES[:3], tiles=5)
    summary = report(found, answers)
    print(summary)
    assert np.abs(found.z).max() < 3.5, summary
