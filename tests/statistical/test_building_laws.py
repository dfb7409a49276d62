"""Laws of a prior that prefers directions and free space: exact draws, the chain beside them, ranks of the truth."""

from __future__ import annotations

import contextlib
import math
from functools import partial
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray

import prf.sampler.directions as directions
from prf.kernels import constants as c
from prf.model.arak import exact_draws, expected_edges
from prf.model.coloring import Coloring, Draws, black_areas, black_at
from prf.model.orientation import PLAIN, Orientation, log_normaliser
from prf.model.window import Window
from prf.sampler import Ensemble, mcmc_draws
from prf.sampler.target import Execution, Target, make_chain, with_map
from tests.driving import advance_until_agreed
from tests.reference.arak_laws import log_partition
from tests.reference.slow_coloring import line_measure, slow_rate
from tests.reference.worlds import World, read_world
from tests.statistical.problems import N_BEAMS, N_SENSORS, ROOM, SCALE, SENSOR
from tests.statistical.ranks import rank_of
from tests.statistical.sbc import World as Ranked
from tests.statistical.sbc import calibrate

SEED = 20261127
UNIT = Window(0.0, 0.0, 2.0, 1.0)
CORRIDOR = Window(0.0, 0.0, 12.0, 0.4)
N_OCTANTS = 8
N_CHAINS, BATCHES = 4, 30
CASES = {
    "oriented": (Orientation(3.0, 0.2), 0.0),
    "angle sampled": (Orientation(2.0, None), 0.0),
    "all sampled": (Orientation(None, None), 0.0),
    "free space": (PLAIN, 1.0),
    "both": (Orientation(3.0, 0.5), 2.0),
}


def directed(draws: Draws) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Draw, direction in [0, pi) and length of every edge."""
    step = np.diff(draws.xy[draws.global_edges()], axis=1)[:, 0]
    return draws.draw_of_edge(), np.arctan2(step[:, 1], step[:, 0]) % math.pi, np.hypot(*step.T)


def z_of(values: NDArray[np.float64], expected: float) -> float:
    return float((values.mean() - expected) / (values.std() / math.sqrt(len(values))))


@pytest.mark.parametrize(("strength", "angle"), [(0.6, 0.3), (3.0, 0.1)])
def test_exact_draws_have_the_directions_that_are_preferred(strength: float, angle: float) -> None:
    """Length by octants of direction, the number of edges, and crossings of both kinds of sides: |z| < 4.5."""
    n, scale = 6000, 0.8
    draws = exact_draws(scale, UNIT, n, np.random.default_rng(SEED), Orientation(strength, angle))
    owner, theta, length = directed(draws)
    octant = (theta / math.pi * N_OCTANTS).astype(int)
    for k in range(N_OCTANTS):
        inside = np.linspace(k, k + 1, 201) * math.pi / N_OCTANTS
        share = np.trapezoid([line_measure(t, strength, angle) for t in inside], inside)
        found = np.bincount(owner[octant == k], length[octant == k], n)
        assert abs(z_of(found, scale * UNIT.area * float(share))) < 4.5
    assert abs(z_of(draws.n_edges.astype(float), expected_edges(scale, UNIT, Orientation(strength, angle)))) < 4.5
    vertex_draw = np.repeat(np.arange(n), np.diff(draws.vertex_offsets))
    for side, reach, direction in ((0, UNIT.width, 0.0), (3, UNIT.height, 0.5 * math.pi)):
        found = np.bincount(vertex_draw[draws.side == side], minlength=n).astype(float)
        rate = slow_rate(direction, scale, strength, angle)
        assert abs(z_of(found, rate * reach)) < 4.5
        assert found.var() == pytest.approx(rate * reach, rel=0.1), "a Poisson number"


@pytest.mark.parametrize("angle", [0.0, math.pi / 4.0])
def test_the_normaliser_is_what_the_empty_map_leaves(angle: float) -> None:
    """P(no edge) = 2 / Z."""
    n, scale, window = 40_000, 0.4, Window(0.0, 0.0, 1.2, 0.8)
    draws = exact_draws(scale, window, n, np.random.default_rng(SEED), Orientation(2.0, angle))
    log_z = log_partition(scale, window) + log_normaliser(2.0, angle, scale, window)
    expected = 2.0 * math.exp(-log_z)
    found = np.mean(draws.n_edges == 0)
    assert abs(found - expected) < 4.5 * math.sqrt(expected * (1.0 - expected) / n)


def quantities(draws: Draws) -> NDArray[np.float64]:
    """What is compared of each draw, (n, 7)."""
    owner, theta, length = directed(draws)
    sums = [np.bincount(owner, w, len(draws)) for w in (length * np.cos(4 * theta), length * np.sin(4 * theta))]
    turned = np.bincount(owner, np.cos(8.0 * theta), len(draws))
    counts = (draws.n_edges, draws.total_length(), black_areas(draws), np.diff(draws.vertex_offsets))
    return np.column_stack([*counts, *sums, turned])


def scores_of_chain(
    name: str, n_exact: int, n_draws: int, scale: float = 1.0, window: Window = UNIT
) -> NDArray[np.float64]:
    """z-scores of the chain's means beside those of exact draws, by batches."""
    orientation, free_space = CASES[name]
    exact = quantities(exact_draws(scale, window, n_exact, np.random.default_rng(SEED), orientation, free_space))
    chains = [mcmc_draws(scale, window, n_draws, None, SEED + k, orientation, free_space)[0] for k in range(N_CHAINS)]
    means = np.concatenate([quantities(draws).reshape(BATCHES, -1, exact.shape[1]).mean(axis=1) for draws in chains])
    error = np.sqrt(means.var(axis=0, ddof=1) / len(means) + exact.var(axis=0) / n_exact)
    return np.asarray((means.mean(axis=0) - exact.mean(axis=0)) / error)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_chain_has_the_law_of_exact_draws(name: str) -> None:
    scores = scores_of_chain(name, 40_000, 3000)
    assert np.abs(scores).max() < 4.5, scores


@pytest.mark.slow
@pytest.mark.parametrize("is_right", [True, False], ids=["right", "control"])
def test_directions_without_their_normaliser_are_caught(is_right: bool) -> None:
    """In a corridor, whose long sides prefer to be crossed: the angle turns if Z does not count."""
    with contextlib.ExitStack() as stack:
        if not is_right:
            stack.enter_context(mock.patch.object(directions, "log_normaliser", return_value=0.0))
        scores = scores_of_chain("angle sampled", 40_000, 6000, 0.5, CORRIDOR)
    worst = np.abs(scores).max()
    assert worst < 4.5 if is_right else worst > 6.0, scores


NAMES = ("number of edges", "length", "black area", "log likelihood", "orientation", "orientation_angle")
N_DRAWS = 40
STEPS = (320_000, 640_000, 1_280_000)
MOST_RHAT = 1.1


def world_of(free_space: float, rng: np.random.Generator) -> tuple[Orientation, World]:
    """Strength, angle and map from the prior, kept as black costs, until the sensors stand in white."""
    place = rng.uniform(ROOM[:2], ROOM[2:], (N_SENSORS, 2))
    while True:
        known = Orientation(*Orientation(None, None).draw(rng))
        draws = exact_draws(SCALE, ROOM, 1, rng, known)
        (truth,) = draws
        is_kept = rng.random() < math.exp(-free_space * black_areas(draws)[0])
        if is_kept and not black_at(truth, place).any():
            return known, read_world(truth, place, SENSOR, N_BEAMS, rng)


def likelihoods(target: Target, draws: Draws) -> NDArray[np.float64]:
    """What is ranked of each map, (n, 4)."""
    counts = (draws.n_edges, draws.total_length(), black_areas(draws))
    chain = make_chain(target, Coloring.empty(target.window))
    sums = [with_map(chain, target, draw).graph.sums[c.LOG_LIKELIHOOD] for draw in draws]
    return np.column_stack([*counts, sums])


def rank_in_world(free_space: float, number: int) -> Ranked:
    """Rank of the truth in one world of which the sampler is not told the directions."""
    rng = np.random.default_rng([SEED, number])
    known, world = world_of(free_space, rng)
    target = Target(
        ROOM,
        SCALE,
        world.data,
        orientation=Orientation(None, None),
        free_space=free_space,
        execution=Execution(resolution=0.25),
    )
    sampler = Ensemble(target, rng.spawn(2))
    rhat = advance_until_agreed(sampler, STEPS, MOST_RHAT)
    sample = sampler.sample()
    kept = np.linspace(0, len(sample.draws) - 1, N_DRAWS).astype(int)
    own = [*likelihoods(target, Draws.from_colorings([world.coloring]))[0], known.strength, known.angle]
    directed = [sample.functionals[name][kept] for name in NAMES[4:]]
    drawn = likelihoods(target, Draws.from_colorings([sample.draws[int(k)] for k in kept]))
    values = np.column_stack([drawn, directed[0], directed[1] % (0.5 * math.pi)])
    return Ranked(rank_of(np.array(own, np.float64), values, rng), rhat < MOST_RHAT, sampler.step)


@pytest.mark.slow
@pytest.mark.parametrize(("free_space", "n_worlds"), [(0.0, 200), (0.3, 100)])
def test_ranks_of_strength_and_angle_are_uniform(free_space: float, n_worlds: int) -> None:
    """Worlds whose directions are drawn and not told: six quantities at 99.8 %, once in 80 by chance."""
    found = calibrate(partial(rank_in_world, free_space), n_worlds, NAMES, N_DRAWS)
    print(found.words())
    assert not found.outside(0.998), found.words()
    assert found.agreed > 0.8, found.words()


@pytest.mark.slow
def test_a_wrong_prior_of_the_strength_is_caught() -> None:
    """The negative control: strengths believed to be a seventh of what they are."""
    with mock.patch.object(directions, "MEAN_STRENGTH", 0.3):
        found = calibrate(partial(rank_in_world, 0.0), 100, NAMES, N_DRAWS)
    assert "orientation" in found.outside(0.998), found.words()
