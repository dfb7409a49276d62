"""With the way driven free, maps are those of the prior whose way is free, exactly; without the guards they are not.

Ten numbers a comparison, hardly independent. |z| < 4.5 fails by chance once in 15,000 for normal means, and once in some
3,000 for the means of the fewest batches here (40).
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import prf.sampler.tiles.part as part
from prf.coloring import Draws
from prf.posterior import Settings
from tests.reference.free_way import obstacles
from tests.statistical import driven, tiled
from tests.verify.problems import driven_problem
from tests.verify.sbc import Arm, run_arm
from tests.verify.ways import plain

SEED = 20050726
COSTS = [pytest.param(np.inf, id="hard"), pytest.param(0.7, id="at a cost")]
FAST = {"n": 40_000, "draws": 400, "thin": 4000, "batches": 25}
FULL = {"n": 400_000, "draws": 4000, "thin": 4000, "batches": 100}


def compared(cost: float, size: dict[str, int], is_guarded: bool = True) -> dict[str, float]:
    with ThreadPoolExecutor(2) as pool:
        chains = pool.map(
            lambda k: driven.chain_draws(cost, size["draws"], size["thin"], SEED + k, is_guarded), range(2)
        )
        exact = driven.exact_means(cost, size["n"], SEED)
        found = driven.z_scores(driven.batch_means([driven.values(draws) for draws in chains], size["batches"]), exact)
    print(found)
    return found


def worst(z: dict[str, float]) -> float:
    return max(abs(value) for value in z.values())


@pytest.mark.parametrize("cost", COSTS)
def test_maps_are_those_of_the_prior_whose_way_is_free(cost: float) -> None:
    z = compared(cost, FAST)
    assert worst(z) < 4.5, z


@pytest.mark.parametrize("cost", COSTS)
def test_without_guards_they_are_not(cost: float) -> None:
    z = compared(cost, FAST, is_guarded=False)
    assert worst(z) > 7.0, z


@pytest.mark.slow
@pytest.mark.parametrize("cost", COSTS)
def test_many_maps_are_those_of_the_prior_whose_way_is_free(cost: float) -> None:
    z = compared(cost, FULL)
    assert worst(z) < 4.0, "once in 1,500 by chance"


def tiled_chains(n_draws: int, cost: float = np.inf) -> list[Draws]:
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda k: tiled.tiled_draws(driven.SETTINGS, n_draws, SEED + k, cost), range(2)))


def test_tiles_leave_the_way_free() -> None:
    for draws in tiled_chains(60):
        assert (obstacles(driven.SETTINGS, draws) == 0).all()


def test_tiles_that_know_nothing_of_it_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(part, "ways_near", lambda ways, tile: np.zeros(len(ways), np.bool_))
    assert sum((obstacles(driven.SETTINGS, draws) > 0).sum() for draws in tiled_chains(200)) > 3


@pytest.mark.slow
@pytest.mark.parametrize("cost", COSTS)
def test_many_maps_of_tiles_are_those_of_the_prior_whose_way_is_free(cost: float) -> None:
    means = driven.batch_means([driven.values(draws) for draws in tiled_chains(2000, cost)], 50)
    z = driven.z_scores(means, driven.exact_means(cost, 200_000, SEED))
    print(z)
    assert worst(z) < 4.0, z


@pytest.mark.slow
def test_ranks_of_worlds_whose_way_is_free_are_uniform() -> None:
    """By calibration, as for occupied sensors: worlds whose way is not free are drawn again.

    Nine numbers, each of which leaves a band of 99 %: by chance once in eleven, so seldom more than one of them.
    """
    found = run_arm(Arm("driven, plain", driven_problem, plain), 100, SEED, 1)
    verdicts = found.verdicts()
    print(verdicts)
    assert found.agreed.mean() >= 0.9
    assert sum(verdict.outside > 0 for verdict in verdicts.values()) <= 1, verdicts
    assert min(verdict.p for verdict in verdicts.values()) > 1e-3, verdicts


@pytest.mark.slow
def test_ranks_of_a_sampler_that_knows_nothing_of_the_way_are_not() -> None:
    found = run_arm(Arm("driven, unknown", driven_problem, plain, without_way), 100, SEED, 1)
    print(found.verdicts())
    assert min(verdict.p for verdict in found.verdicts().values()) < 1e-4


def without_way(settings: Settings) -> Settings:
    return dataclasses.replace(settings, way=np.zeros((0, 4)))
