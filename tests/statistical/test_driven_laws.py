"""With the way driven free, maps are those of the prior whose way is free, exactly; without the guards they are not.

Ten numbers a comparison: |z| < 4.5 fails by chance once in 15,000 for normal means, once in some 2,400 for those of 50
batches; |z| < 4.0 once in 1,500 of the long ones.
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely

import prf.sampler.tiles.part as part
from prf.model.coloring import Draws
from prf.sampler.target import Target
from tests.reference.free_way import obstacles, pieces
from tests.statistical import driven, tiled
from tests.statistical.means import Floats, batch_mean, largest, z_scores
from tests.statistical.problems import NAMES, driven_problem, values
from tests.statistical.ranks import Verdict
from tests.statistical.sbc import Arm, run_arm
from tests.statistical.ways import plain

SEED = 20050726
COSTS = [pytest.param(np.inf, id="hard"), pytest.param(0.7, id="at a cost")]
N_WORLDS = 200
SOME = {"n": 40_000, "draws": 400, "thin": 4000, "batches": 25}
MANY = {"n": 400_000, "draws": 4000, "thin": 4000, "batches": 100}


def compared(cost: float, size: dict[str, int], is_guarded: bool = True) -> dict[str, float]:
    with ThreadPoolExecutor(2) as pool:
        chains = pool.map(
            lambda k: driven.chain_draws(cost, size["draws"], size["thin"], SEED + k, is_guarded), range(2)
        )
        found = batch_mean([driven.values(draws) for draws in chains], size["batches"])
    return named(z_scores(found, driven.exact_means(cost, size["n"], SEED)))


def named(z: Floats) -> dict[str, float]:
    return dict(zip(driven.NAMES, z.round(2).tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("size", "limit"), [(SOME, 4.5), (MANY, 4.0)], ids=["some", "many"])
@pytest.mark.parametrize("cost", COSTS)
def test_maps_are_those_of_the_prior_whose_way_is_free(cost: float, size: dict[str, int], limit: float) -> None:
    z = compared(cost, size)
    assert largest(z)[1] < limit, z


@pytest.mark.slow
@pytest.mark.parametrize("cost", COSTS)
def test_without_guards_they_are_not(cost: float) -> None:
    z = compared(cost, SOME, is_guarded=False)
    assert largest(z)[1] > 7.0, z


def tiled_chains(n_draws: int, cost: float = np.inf) -> list[Draws]:
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda k: tiled.tiled_draws(driven.TARGET, n_draws, SEED + k, cost), range(2)))


@pytest.mark.slow
def test_tiles_leave_the_way_free() -> None:
    for draws in tiled_chains(30):
        assert (obstacles(driven.TARGET, draws) == 0).all()


@pytest.mark.slow
def test_tiles_that_know_nothing_of_it_do_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(part, "ways_near", lambda ways, tile: np.zeros(len(ways), np.bool_))
    assert sum((obstacles(driven.TARGET, draws) > 0).sum() for draws in tiled_chains(200)) > 3


@pytest.mark.slow
@pytest.mark.parametrize("cost", COSTS)
def test_many_maps_of_tiles_are_those_of_the_prior_whose_way_is_free(cost: float) -> None:
    means = batch_mean([driven.values(draws) for draws in tiled_chains(2000, cost)], 50)
    z = named(z_scores(means, driven.exact_means(cost, 200_000, SEED)))
    assert largest(z)[1] < 4.0, z


def clearance(target: Target, draws: Draws) -> Floats:
    """Metres from the way to the nearest edge (n_draws,); 10 m without one."""
    edges = (shapely.linestrings(draw.segments().reshape(-1, 2, 2)) for draw in draws)
    return np.array([shapely.distance(lines[:, None], pieces(target)).min(initial=10.0) for lines in edges])


def values_and_clearance(target: Target, draws: Draws) -> Floats:
    return np.column_stack([values(target, draws), clearance(target, draws)])


def verdicts(way: np.ndarray | None = None) -> dict[str, Verdict]:
    """How uniform the ranks of the truth are, if the sampler is given this way in place of the right one."""

    def spoil(target: Target) -> Target:
        return target if way is None else dataclasses.replace(target, way=way)

    arm = Arm("driven", driven_problem, plain, spoil, (*NAMES, "clearance"), values_and_clearance)
    return run_arm(arm, N_WORLDS, SEED, 1).verdicts()


@pytest.mark.slow
def test_ranks_of_worlds_whose_way_is_free_are_uniform() -> None:
    """By calibration, as for occupied sensors: worlds whose way is not free are drawn again.

    Ten numbers, each below 0.0005 once in 2000: by chance once in 200 of them all.
    """
    found = verdicts()
    assert min(verdict.p for verdict in found.values()) > 5e-4, found


@pytest.mark.slow
def test_ranks_of_a_sampler_that_knows_nothing_of_the_way_are_not() -> None:
    found = verdicts(np.zeros((0, 4)))
    assert found["clearance"].p < 1e-4
    assert found["clearance"].outside > 10
