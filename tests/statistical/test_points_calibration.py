"""Worlds from the prior, values from the point models: probabilities are the shares observed, ranks are uniform.

The truth is one more draw from the posterior given its own data. So a point that is black with probability p is black
in a share p of the worlds, and the place of the truth among draws, by any number that a map has, is uniform.
"""

from __future__ import annotations

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, black_at_draws
from prf.model.window import Window
from prf.sampler.posterior import PointData, Settings
from tests.reference.slow_points import Flips, Normal, lattice, observe
from tests.statistical.test_calibration import Answer, calibrate, sampled

SEED = 20261122
SCALE = 0.25
ROOM = Window(0.0, 0.0, 5.0, 4.0)
N_WORLDS, N_POINTS, N_PROBES = 60, 30, 100
STAGES = ((400_000, 1.1), (800_000, 1.1))
N_DRAWS = 49
"""Draws among which the truth is placed: some 16,000 steps or more apart, about twice the autocorrelation time."""
LIMIT = 3.5
"""For 5 bins and 8 moments of ranks: one of them is beyond it by chance once in 165."""
QUANTITIES = ("edges", "length", "black area", "log likelihood")


class Case(NamedTuple):
    """How the points observe, and where they lie: on a lattice or scattered."""

    law: Normal | Flips
    on_lattice: bool


CASES = {"gaussian, scattered": Case(Normal(sigma=0.8), False), "binary, lattice": Case(Flips(0.2), True)}


class World(NamedTuple):
    """What one world gave: colours of random points, and the share of draws below the truth by each quantity."""

    answer: Answer
    rank: NDArray[np.float64]


def quantities(draws: Draws, data: PointData) -> NDArray[np.float64]:
    """Numbers of each map, (n_draws, len(QUANTITIES))."""
    density = data.model.log_density(data.table.value)
    told = np.where(black_at_draws(draws, data.table.xy), density[:, 1], density[:, 0]).sum(axis=1)
    return np.column_stack([draws.n_edges, draws.total_length(), black_areas(draws), told])


def rank_of(truth: Coloring, draws: Draws, data: PointData, rng: np.random.Generator) -> NDArray[np.float64]:
    """Share of draws below the truth, ties broken at random, in (0, 1)."""
    own = quantities(Draws.from_colorings([truth]), data)
    others = quantities(draws, data)
    below = (others < own).sum(axis=0) + rng.binomial((others == own).sum(axis=0), rng.random(len(QUANTITIES)))
    found: NDArray[np.float64] = (below + rng.random(len(QUANTITIES))) / (len(others) + 1)
    return found


def one_world(number: int, case: Case, sharper: float) -> World:
    """Sample the posterior of one world; `sharper` is how much surer of the values than they are the model is."""
    rng = np.random.default_rng([SEED, number])
    truth = exact_draws(SCALE, ROOM, 1, rng)[0]
    xy = lattice(6, 0.0, 4.0) if case.on_lattice else rng.uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2))
    data = observe(truth, case.law, xy, rng)
    model = dataclasses.replace(
        data.model,
        sigma=None if data.model.sigma is None else data.model.sigma / sharper,
        flip_probability=data.model.flip_probability / sharper,
    )
    settings = Settings(ROOM, SCALE, points=dataclasses.replace(data, model=model), resolution=0.25)
    draws, rhat = sampled(settings, SEED + number, STAGES)
    probes = rng.uniform(ROOM[:2], ROOM[2:], (N_PROBES, 2))
    answer = Answer(black_at_draws(draws, probes).mean(axis=0), black_at(truth, probes), rhat)
    kept = np.linspace(0, len(draws) - 1, N_DRAWS).astype(int)
    return World(answer, rank_of(truth, Draws.from_colorings([draws[int(k)] for k in kept]), data, rng))


def z_of_ranks(worlds: list[World]) -> NDArray[np.float64]:
    """z-scores (2, len(QUANTITIES)) of the ranks' mean and of their mean square round 1/2: if uniform, 1/2 and 1/12."""
    centred = np.array([world.rank for world in worlds]) - 0.5
    root = np.sqrt(len(worlds))
    return np.array(
        [centred.mean(axis=0) * root / np.sqrt(1 / 12), ((centred**2).mean(axis=0) - 1 / 12) * root / np.sqrt(1 / 180)]
    )


def run_worlds(name: str, n_worlds: int, sharper: float = 1.0) -> tuple[float, str]:
    """Worst z-score of shares and ranks, and all of them in words. Two worlds at a time."""
    with ThreadPoolExecutor(2) as pool:
        worlds = list(pool.map(lambda number: one_world(number, CASES[name], sharper), range(n_worlds)))
    answers = [world.answer for world in worlds]
    shares, ranks = calibrate(answers), z_of_ranks(worlds)
    rhat = np.array([answer.rhat for answer in answers])
    lines = [f"{name}, sharper {sharper}: seed {SEED}, {n_worlds} worlds, R-hat up to {rhat.max():.2f}, |z| < {LIMIT}"]
    lines += [
        f"  {n:5d} points: predicted {p:.3f}, observed {o:.3f}, z {z:+.2f}" for n, p, o, z in zip(*shares, strict=True)
    ]
    lines += [f"  {what}: rank z {a:+.2f}, {b:+.2f}" for what, a, b in zip(QUANTITIES, *ranks, strict=True)]
    return max(float(np.abs(shares.z).max()), float(np.abs(ranks).max())), "\n".join(lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_probabilities_are_the_shares_observed_and_ranks_are_uniform(name: str) -> None:
    worst, words = run_worlds(name, N_WORLDS)
    print(words)
    assert worst < LIMIT, words


@pytest.mark.slow
def test_values_believed_too_much_are_caught() -> None:
    worst, words = run_worlds("gaussian, scattered", N_WORLDS // 2, sharper=2.0)
    print(words)
    assert worst > LIMIT, words
