"""The chain on few points in a small window, against exact draws of the prior weighted by the likelihood.

Where the map may well have one colour throughout, both colours must come up, each as often as the points say.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from prf.model.arak import exact_draws
from prf.model.coloring import Draws, black_at_draws
from prf.model.layout import read_coloring
from prf.model.points import log_density
from prf.model.window import Window
from prf.sampler.target import PointData, Target, make_chain, one_colour_map, point_data, run_chain
from tests.reference.slow_points import Flips, Normal
from tests.statistical.means import Floats, Mean, batch_mean, weighted_mean, z_scores

SEED = 20261121
UNIT = Window(0.0, 0.0, 1.0, 1.0)
THIN, BURN_IN, N_BATCHES = 250, 50_000, 50
LIMIT = 4.0
"""One of the 43 means that are looked at lies beyond it by chance once in 110 (t of 49 degrees of freedom)."""


class Case(NamedTuple):
    """A scale, and how the points observe."""

    scale: float
    n_points: int
    law: Normal | Flips


CASES = {
    "mostly one colour, gaussian": Case(0.1, 5, Normal(sigma=1.0)),
    "some walls, gaussian": Case(0.4, 7, Normal(sigma=1.0)),
    "some walls, binary": Case(0.4, 7, Flips(0.3)),
}


def observations(case: Case) -> PointData:
    """Values that disagree, more of them black: every map stays possible."""
    rng = np.random.default_rng([SEED, case.n_points])
    black = np.arange(case.n_points) % 3 != 0
    return point_data(rng.uniform(0.0, 1.0, (case.n_points, 2)), case.law.draw(black, rng), case.law.model)


def functionals(draws: Draws, data: PointData) -> tuple[Floats, Floats]:
    """What is compared, (n, n_functionals), and the log likelihood of each draw (n,)."""
    probes = np.random.default_rng([SEED, 1]).uniform(0.0, 1.0, (3, 2))
    black = black_at_draws(draws, np.concatenate([data.readings.xy, probes]))
    density = log_density(data.model, data.readings.value)
    log_likelihood = np.where(black[:, : len(data.readings.xy)], density[:, 1], density[:, 0]).sum(axis=1)
    edges, anchor = draws.n_edges, draws.anchor_black
    walls = [edges, draws.total_length(), (edges == 0) & anchor, (edges == 0) & ~anchor]
    return np.column_stack([black, *walls, log_likelihood]).astype(float), log_likelihood


@cache
def exact(name: str) -> Mean:
    """Posterior means of the functionals, by weighted draws from the prior."""
    case = CASES[name]
    draws = exact_draws(case.scale, UNIT, 60_000, np.random.default_rng([SEED, 2]))
    values, log_likelihood = functionals(draws, observations(case))
    weight = np.exp(log_likelihood - log_likelihood.max())
    assert weight.sum() ** 2 / (weight**2).sum() > 10_000
    return weighted_mean(values, log_likelihood)


def compared(name: str, repeat: int, steps: int) -> Floats:
    """z-scores of the chain's means; `repeat` is how often each point is counted, 1 being right."""
    case = CASES[name]
    data = observations(case)
    told = point_data(np.tile(data.readings.xy, (repeat, 1)), np.tile(data.readings.value, repeat), data.model)
    target = Target(UNIT, case.scale, points=told)
    chain, rng = make_chain(target, one_colour_map(target)), np.random.default_rng([SEED, 3])
    maps = []
    for until in range(BURN_IN, steps + 1, THIN):
        chain = run_chain(chain, rng, until)
        maps.append(read_coloring(chain.graph))
    values, _ = functionals(Draws.from_colorings(maps, UNIT), data)
    return z_scores(batch_mean([values], N_BATCHES), exact(name))


@pytest.mark.parametrize("name", CASES)
def test_the_chain_has_the_means_of_weighted_exact_draws(name: str) -> None:
    z = compared(name, 1, 1_000_000)
    assert np.abs(z).max() < LIMIT, z


@pytest.mark.slow
def test_points_counted_twice_are_caught() -> None:
    z = compared("some walls, gaussian", 2, 1_000_000)
    assert np.abs(z).max() > 2.0 * LIMIT, z
