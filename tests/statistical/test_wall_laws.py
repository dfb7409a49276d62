"""The law of maps of walls: the chain without readings against rejection, and with a laser by ranks of the truth."""

from __future__ import annotations

import dataclasses
import math
from functools import partial

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.coloring import black_at
from prf.model.orientation import Orientation
from prf.model.walls import WallPrior, map_of_walls, united
from prf.model.window import Window
from prf.sampler import Ensemble
from prf.sampler.target import Execution, Target, make_chain
from tests.driving import advance_until_agreed
from tests.reference.worlds import read_world
from tests.statistical.problems import N_BEAMS, N_SENSORS, SENSOR
from tests.statistical.ranks import rank_of
from tests.statistical.sbc import World, calibrate
from tests.statistical.wall_laws import by_chain, by_rejection, log_constant, mean_of, one_draw, other_law, z_scores

pytestmark = pytest.mark.slow

WORST = 4.0
"""Standard errors: of nine numbers one is beyond it by chance once in 1,750 runs."""


def test_the_prior_has_the_law_of_rejection_and_another_law_is_told() -> None:
    chain = by_chain(30_000, 5)
    found = z_scores(chain, by_rejection(10_000, 6))
    assert max(map(abs, found.values())) < WORST, found
    control = z_scores(chain, by_rejection(10_000, 7, other_law()))
    assert max(map(abs, control.values())) > WORST, control


@pytest.mark.parametrize(("weight", "of", "sign"), [("density", "walls", 1.0), ("free_end", "free ends", -1.0)])
def test_constants_are_the_integrals_of_means(weight: str, of: str, sign: float) -> None:
    """Thermodynamics: d log Z / d log density is the mean number of walls, and -d log Z / d cost that of free ends."""
    most = getattr(PRIOR, weight)
    nodes, shares = np.polynomial.legendre.leggauss(4)
    integral, variance = 0.0, 0.0
    for k, (node, share) in enumerate(zip(0.5 * most * (nodes + 1.0), 0.5 * most * shares, strict=True)):
        mean, error = mean_of(by_chain(6_000, 11 + k, dataclasses.replace(PRIOR, **{weight: node})), of)
        share *= sign / (node if weight == "density" else 1.0)
        integral, variance = integral + share * mean, variance + (share * error) ** 2
    for at, sign_there in ((most, -1.0), (0.0, 1.0)):
        constant, error = log_constant(12_000, 31, dataclasses.replace(PRIOR, **{weight: at}))
        integral, variance = integral + sign_there * constant, variance + error**2
    assert abs(integral) < WORST * math.sqrt(variance), (integral, variance)
    assert math.sqrt(variance) < 0.05


SEED = 20260728
ROOM = Window(0.0, 0.0, 2.4, 2.0)
PRIOR = WallPrior(density=1.4, length=0.8, thickness=0.1, free_end=0.4, crossing=0.9)
NAMES = ("walls", "length", "log likelihood", "area of walls", "orientation")
N_DRAWS = 40
STEPS = (160_000, 320_000, 640_000)
MOST_RHAT = 1.1


def rank_in_world(believed: float, number: int) -> World:
    """Rank of the truth in one world; `believed`: factor on the density of walls in the prior of the sampler."""
    rng = np.random.default_rng([SEED, number])
    place = rng.uniform(ROOM[:2], ROOM[2:], (N_SENSORS, 2))
    while True:
        truth = one_draw(rng, PRIOR, ROOM)
        rectangles = map_of_walls(truth.walls, ROOM)
        region = united(rectangles)
        if not black_at(region, place).any():
            break
    world = read_world(region, place, SENSOR, N_BEAMS, rng)
    told = WallPrior(PRIOR.density * believed, PRIOR.length, PRIOR.thickness, PRIOR.free_end, PRIOR.crossing)
    known = Orientation(None, None)
    target = Target(ROOM, 0.3, world.data, orientation=known, walls=told, execution=Execution(resolution=0.25))
    sampler = Ensemble(target, rng.spawn(2))
    rhat = advance_until_agreed(sampler, STEPS, MOST_RHAT)
    sample = sampler.sample()
    assert sample.walls is not None
    kept = np.linspace(0, len(sample.draws) - 1, N_DRAWS).astype(int)
    strength = sample.functionals["orientation"][kept]
    drawn = np.column_stack([[ranked(target, sample.walls[int(k)]) for k in kept], strength])
    own = np.array([*ranked(target, truth.walls), truth.strength])
    return World(rank_of(own, drawn, rng), rhat < MOST_RHAT, sampler.step)


def ranked(target: Target, walls: np.ndarray) -> list[float]:
    """Number, length, log likelihood and area of walls, anew: sums that a chain keeps tell equal maps apart."""
    length = np.hypot(*(walls[:, 2:4] - walls[:, :2]).T)
    chain = make_chain(target, map_of_walls(walls, target.window))
    likelihood = float(chain.graph.sums[c.LOG_LIKELIHOOD])
    return [len(walls), float(length.sum()), likelihood, float((length * walls[:, 4]).sum())]


def test_ranks_of_the_truth_are_uniform() -> None:
    """Worlds of walls seen by a laser: five quantities at 99.8 %, once in 100 by chance."""
    found = calibrate(partial(rank_in_world, 1.0), 200, NAMES, N_DRAWS)
    print(found.words())
    assert not found.outside(0.998), found.words()
    assert found.agreed > 0.8, found.words()


def test_a_wrong_density_of_walls_is_caught() -> None:
    """The negative control: as if there were five times as many walls."""
    found = calibrate(partial(rank_in_world, 5.0), 100, NAMES, N_DRAWS)
    assert "walls" in found.outside(0.998), found.words()
