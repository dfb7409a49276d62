"""Steps in regions keep the prior and the posterior, wherever the regions lie; one that looks at the map does not."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_at
from prf.model.layout import make_graph, make_targets, read_coloring
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.sampler import schedules as focusing
from prf.sampler.schedules import Regions
from prf.sampler.target import Execution, Target, Tuning, laser_data, make_chain, with_graph
from tests.driving import run_to
from tests.statistical.laws import LawScores, law_scores
from tests.statistical.means import Mean, batch_mean, largest, weighted_mean, z_scores

SEED = 20050726
UNIT = Window(0.0, 0.0, 1.0, 1.0)
SIDE = 0.05
HALF = 0.2
"""Half of the side of a region, metres: a sixth of the window."""
TURN = 250
TURNS = 4
"""Steps of a turn here, and turns of a cycle: many short ones in regions show sooner what is wrong with how these are
chosen."""
THIN = 8 * TURN


@pytest.fixture(autouse=True)
def short_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(focusing, "TURN", TURN)
    monkeypatch.setattr(focusing, "TURNS", TURNS)


Hook = Callable[[Chain], None]


def look_away(chain: Chain) -> None:
    """Leave the targets as they are."""


def look_at_black(chain: Chain) -> None:
    """Let all regions lie round targets in black: what no region may know."""
    grid, cell = chain.targets.grid, chain.targets.cell
    x = grid.x0 + (cell % grid.nx + 0.5) * grid.cell
    y = grid.y0 + (cell // grid.nx + 0.5) * grid.cell
    inside = np.clip(np.column_stack([x, y]), 0.001, 0.999)
    weight = 1e-9 + black_at(read_coloring(chain.graph), inside)
    chain.targets.cumulative[:] = np.cumsum(weight) / weight.sum()


def focused_draws(target: Target, n_draws: int, seed: int, hook: Hook = look_away) -> Draws:
    """Every eighth turn's map of a chain that makes three turns of four in regions."""
    rng = np.random.default_rng(seed)
    chain = make_chain(target, Coloring.empty(UNIT))
    chain = chain._replace(targets=make_targets(UNIT, SIDE, np.random.default_rng(SEED).random((60, 2))))
    chain.tuning[c.AIMED_SHARE] = 0.6
    regions, maps = Regions(chain), []
    regions.half = HALF
    for number in range(n_draws + 20):
        for turn in range(8):
            hook(chain)
            chain = run_to(regions, chain, rng, number * THIN + (turn + 1) * TURN)
        recompute_sums(chain)
        if number >= 20:
            maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, UNIT)


def prior_scores(n_draws: int, batch: int, hook: Hook = look_away) -> LawScores:
    target = Target(UNIT, 1.0, tuning=Tuning(cut_reach=0.05, join_reach=0.1), execution=Execution(cell=0.2))
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: focused_draws(target, n_draws, SEED + k, hook), range(2)))
    ids = np.repeat(np.arange(2), n_draws)
    return law_scores(
        Draws.from_colorings([draw for chain in chains for draw in chain]), 1.0, UNIT, chain_ids=ids, batch=batch
    )


@pytest.mark.parametrize(("n_draws", "batch"), [(500, 20), pytest.param(15_000, 150, marks=pytest.mark.slow)])
def test_the_prior_keeps_its_laws(n_draws: int, batch: int) -> None:
    scores = prior_scores(n_draws, batch)
    assert not scores.beyond(4.5), scores.worst()


@pytest.mark.slow
def test_regions_that_look_at_the_map_are_caught() -> None:
    """The negative control."""
    assert prior_scores(1500, 30, look_at_black).beyond(6.0)


ANGLE = np.linspace(-2.9, 3.0, 12)
READINGS = np.array([0.2, 0.3, np.inf, 0.25, 0.4, 0.3, np.inf, 0.35, 0.2, np.inf, 0.45, 0.3])
BLUNT = LaserModel(0.5, 0.04, outlier_probability=0.5, miss_probability=0.3)
TARGET = Target(
    UNIT, 1.0, laser_data(np.tile([0.53, 0.47], (12, 1)), ANGLE, READINGS, BLUNT), execution=Execution(cell=0.2)
)
"""A laser that says what it says so bluntly that draws of the prior may be weighted."""
NAMES = ("edges", "length", "corners in the middle", "log likelihood", *(f"black {k}" for k in range(6)))
PLACES = np.random.default_rng(SEED).random((6, 2))


def compared(draws: Draws) -> np.ndarray:
    """Values (n_draws, len(NAMES)) from the maps alone."""
    chain = make_chain(TARGET, Coloring.empty(UNIT))
    rows = []
    for draw in draws:
        graph = make_graph(draw, 2 * draw.n_vertices + 64)
        likelihood = with_graph(chain, TARGET, graph).graph.sums[c.LOG_LIKELIHOOD]
        middle = (np.abs(draw.xy - 0.5) < 0.2).all(axis=1).sum()
        rows.append([draw.n_edges, draw.total_length(), middle, likelihood, *black_at(draw, PLACES)])
    return np.array(rows, np.float64)


def weighted_means(n: int) -> Mean:
    """Of draws of the prior in which the sensor is free, weighted by their likelihood."""
    draws = exact_draws(1.0, UNIT, n, np.random.default_rng(SEED))
    free = np.flatnonzero([not black_at(draw, TARGET.laser.readings.origin[:1])[0] for draw in draws])  # type: ignore[union-attr]
    found = compared(Draws.from_colorings([draws[int(k)] for k in free]))
    return weighted_mean(found, found[:, 3])


def posterior_scores(n_draws: int, n_exact: int, hook: Hook = look_away) -> dict[str, float]:
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: focused_draws(TARGET, n_draws, SEED + k, hook), range(2)))
    found = batch_mean([compared(draws) for draws in chains], 30)
    return dict(zip(NAMES, z_scores(found, weighted_means(n_exact)).tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("n_draws", "n_exact"), [(900, 20_000), (9000, 150_000)])
def test_maps_are_those_of_the_posterior(n_draws: int, n_exact: int) -> None:
    """Ten numbers: |z| < 4.5 fails by chance once in some thousands."""
    z = posterior_scores(n_draws, n_exact)
    assert largest(z)[1] < 4.5, z
