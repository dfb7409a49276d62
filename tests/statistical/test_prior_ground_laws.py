"""Steps on ground that no reading concerns keep the posterior, and bring the prior to where nothing was seen.

Eleven numbers a comparison: |z| < 4.5 fails by chance once in 13,000 for normal means, once in some 2,200 for those of
50 batches.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_at_draws
from prf.model.layout import make_graph, read_coloring
from prf.model.sensors import LaserModel
from prf.model.window import INTERIOR, Window
from prf.sampler.chain import ChainRun
from prf.sampler.starts import PriorGround, edge_density
from prf.sampler.target import Target, laser_data, make_chain, run_chain, with_graph
from tests.reference.free_way import is_free
from tests.statistical.driven import NAMES, ROOM, values
from tests.statistical.means import Mean, batch_mean, largest, weighted_mean, z_scores

SEED = 20050726
ANGLE = np.array([-2.8, -0.9, 0.2, 1.4])
READINGS = np.array([1.2, 0.8, 1.6, np.inf])
"""A wall may stand where three beams of four ended; they say so bluntly, that draws of the prior may be weighted."""
LASER = laser_data(
    np.tile([3.0, 3.2], (4, 1)), ANGLE, READINGS, LaserModel(2.0, 0.08, outlier_probability=0.4, miss_probability=0.4)
)
TARGET = Target(ROOM, 0.25, LASER, way=np.array([[4.2, 0.5, 5.2, 0.4]]), driven_radius=0.2)


def log_likelihoods(draws: Draws) -> np.ndarray:
    """From the maps alone (n_draws,)."""
    chain = make_chain(TARGET, Coloring.empty(ROOM))
    graphs = (make_graph(draw, 2 * draw.n_vertices + 64) for draw in draws)
    return np.array([with_graph(chain, TARGET, graph).graph.sums[c.LOG_LIKELIHOOD] for graph in graphs])


def compared(draws: Draws) -> np.ndarray:
    return np.column_stack([values(draws), log_likelihoods(draws)])


def weighted_means(n: int) -> Mean:
    """Of draws of the prior in which sensor and way are free, weighted by their likelihood."""
    draws = exact_draws(TARGET.scale, ROOM, n, np.random.default_rng(SEED))
    found = compared(Draws.from_colorings([draw for draw in draws if is_free(TARGET, draw)]))
    return weighted_mean(found, found[:, -1])


def refreshed_draws(n_draws: int, seed: int, is_closed: bool = True) -> Draws:
    """Maps of a chain of blocks of 2000 steps with 2000 proposals between them where no reading concerns."""
    chain, rng, maps = make_chain(TARGET, Coloring.empty(ROOM)), np.random.default_rng(seed), []
    ground = PriorGround(TARGET, chain)
    for number in range(n_draws + 20):
        for _ in range(2):
            chain = run_chain(chain, rng, int(chain.graph.counts[c.STEP]) + 2000)
            guards = ground.closed(chain)
            if not is_closed:
                guards = guards._replace(lists=np.zeros_like(guards.lists))
            chain = ground.settle(ground.refresh(chain, guards, rng, 2000))
            recompute_sums(chain)
        if number >= 20:
            maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, ROOM)


def scores(n_draws: int, n_exact: int, is_closed: bool = True) -> dict[str, float]:
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: refreshed_draws(n_draws, SEED + k, is_closed), range(2)))
    z = z_scores(batch_mean([compared(draws) for draws in chains], 25), weighted_means(n_exact))
    return dict(zip((*NAMES, "log likelihood"), z.round(2).tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("n_draws", "n_exact", "limit"), [(500, 20_000, 4.5), (5000, 150_000, 4.0)])
def test_maps_are_those_of_the_posterior(n_draws: int, n_exact: int, limit: float) -> None:
    z = scores(n_draws, n_exact)
    assert largest(z)[1] < limit, z


@pytest.mark.slow
def test_steps_on_closed_ground_are_caught() -> None:
    """The negative control: half of the proposals know nothing of the readings."""
    z = scores(500, 20_000, is_closed=False)
    assert largest(z)[1] > 6.0, z


FAR = Window(10.0, 2.0, 28.0, 28.0)
WIDE = Target(Window(0.0, 0.0, 30.0, 30.0), 0.1, LASER)
PLACES = np.random.default_rng(SEED).uniform(FAR[:2], FAR[2:], (40, 2))


def first_draw(number: int) -> Coloring:
    sampler = ChainRun(WIDE, np.random.default_rng([SEED, number]), np.zeros(0, np.int64))
    sampler.find_start(math.inf, lambda: False)
    return read_coloring(sampler.chain.graph)


@pytest.mark.slow
def test_far_from_every_reading_the_first_map_is_a_draw_of_the_prior() -> None:
    """Corners a square metre 4 pi p^2, half of the ground black; each once in 15,000 by chance beyond 4."""
    with ThreadPoolExecutor(2) as pool:
        draws = Draws.from_colorings(list(pool.map(first_draw, range(60))), WIDE.window)
    inside = FAR.contains(draws.xy) & (draws.side == INTERIOR)
    owner = np.repeat(np.arange(len(draws)), np.diff(draws.vertex_offsets))
    corners = np.bincount(owner, inside, len(draws)) / FAR.area
    black = black_at_draws(draws, PLACES).mean(axis=1)
    for found, expected in ((corners, edge_density(WIDE.scale)), (black, 0.5)):
        error = found.std(ddof=1) / np.sqrt(len(found))
        print(found.mean(), expected, error)
        assert error < 0.1 * expected
        assert abs(found.mean() - expected) < 4.0 * error
    assert np.abs(black_at_draws(draws, PLACES).mean(axis=0) - 0.5).max() < 4.0 * 0.5 / np.sqrt(60)
