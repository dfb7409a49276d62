"""Every temperature of parallel tempering has its law: the weighted prior; and wrong swaps are caught."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.layout import read_coloring
from prf.model.ranges import deal_levels
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.sampler.schedules import Ladder, LadderPlan
from prf.sampler.target import Target, laser_data, make_chain, run_chain, with_map
from tests.driving import run_to
from tests.statistical.means import Floats, Mean, batch_mean, largest, weighted_mean, z_scores

# Temperatures of parallel tempering on readings that say little, against weighted exact draws of the prior.
#
# Weights say exactly what the law at every temperature is; where they are not too uneven, draws of the prior are draws
# of it.


WINDOW = Window(0.0, 0.0, 4.0, 4.0)
SCALE = 0.3
SENSORS = np.array([[1.1, 1.3], [2.9, 2.4]])
PLACES = np.array([[2.9, 0.9], [0.4, 3.2]])
COST = 2.0
POWERS = np.array([1.0, 0.6, 0.25, 0.0])
SPACING = 50
"""Steps between two tries to swap: few, so that a wrong ratio of swaps is not undone by right steps."""
N_BATCHES = 40
BURN_IN = 200
NAMES = ("edges", "length", "log likelihood", "occupied sensors", "black right", "black left")


def blunt_target() -> Target:
    """Six beams of an unsure laser."""
    angle = np.tile([0.0, 0.5 * np.pi, np.pi], 2)
    readings = np.array([0.9, 1.5, np.inf, 0.6, np.inf, 1.0])
    model = LaserModel(3.0, noise=0.4, outlier_probability=0.4, miss_probability=0.1)
    return Target(WINDOW, SCALE, laser_data(np.repeat(SENSORS, 3, axis=0), angle, readings, model))


def functionals(chain: Chain, coloring: Coloring) -> list[float]:
    black = black_at(coloring, np.concatenate([SENSORS, PLACES])).astype(float)
    log_likelihood = float(chain.graph.sums[c.LOG_LIKELIHOOD])
    return [coloring.n_edges, coloring.total_length(), log_likelihood, black[:2].sum(), *black[2:]]


def exact_values(target: Target, n: int, seed: int) -> Floats:
    """Functionals (n, len(NAMES)) of exact draws of the prior."""
    chain = make_chain(target, Coloring.empty(WINDOW))
    rows = []
    for draw in exact_draws(SCALE, WINDOW, n, np.random.default_rng(seed)):
        chain = with_map(chain, target, draw)
        rows.append(functionals(chain, draw))
    return np.array(rows)


def exact_means(values: Floats) -> list[Mean]:
    """By temperature; on the cold chain no sensor may be occupied."""
    log_likelihood, occupied = values[:, 2], values[:, 3]
    cold = np.where(occupied > 0, -np.inf, log_likelihood)
    return [
        weighted_mean(values, cold if power == 1.0 else power * (log_likelihood - COST * occupied)) for power in POWERS
    ]


class Costless(Ladder):
    """The mistake: swaps forget what occupied sensors cost."""

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        log_ratio = super().log_swap_ratio(pair, colder, hotter)
        counts = [chain.graph.counts[c.OCCUPIED] for chain in (hotter, colder)]
        powers = self.powers
        return log_ratio + float((powers[pair] - powers[pair + 1]) * self.cost * (counts[0] - counts[1]))


class Unforbidden(Ladder):
    """The mistake: a map with an occupied sensor may come to the cold chain, at the cost that the others ask."""

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        log_ratio = super().log_swap_ratio(pair, colder, hotter)
        if log_ratio > -np.inf:
            return log_ratio
        sums = [chain.graph.sums[c.LOG_LIKELIHOOD] for chain in (hotter, colder)]
        cost = self.cost * hotter.graph.counts[c.OCCUPIED]
        return float((self.powers[0] - self.powers[1]) * (sums[0] - cost - sums[1]))


def sampled_means(target: Target, n_swaps: int, seed: int, kind: type[Ladder] = Ladder) -> list[Mean]:
    """By temperature, over one run at fixed powers, looked at after every try to swap."""
    rng = np.random.default_rng(seed)
    cold = make_chain(target, Coloring.empty(WINDOW))
    tempering = kind(target, cold, rng, LadderPlan(len(POWERS), 0.0, COST))
    tempering.spacing = SPACING
    tempering.powers[:] = POWERS
    tempering.apply_powers()
    rows = []
    for swap in range(1, n_swaps + 1):
        cold = run_to(tempering, cold, rng, swap * SPACING)
        if swap > BURN_IN:
            rows.append([functionals(chain, read_coloring(chain.graph)) for chain in (cold, *tempering.hot)])
    kept = np.array(rows)
    return [batch_mean([kept[:, k]], N_BATCHES) for k in range(len(POWERS))]


SEED = 20050726


def scores(n_exact: int, n_swaps: int, kind: type[Ladder] = Ladder) -> dict[str, float]:
    target = blunt_target()
    pairs = zip(
        sampled_means(target, n_swaps, SEED, kind), exact_means(exact_values(target, n_exact, SEED)), strict=True
    )
    z = [z_scores(found, exact) for found, exact in pairs]
    return {f"temperature {k}: {name}": float(z[k][i]) for k in range(len(POWERS)) for i, name in enumerate(NAMES)}


@pytest.mark.slow
def test_every_chain_of_a_ladder_has_its_law() -> None:
    z = scores(4000, 6000)
    assert len(z) == len(POWERS) * len(NAMES)
    assert largest(z)[1] < 4.5, (SEED, largest(z))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "temperature"),
    [(Costless, 1), (Unforbidden, 0)],
    ids=["swaps without the cost", "black sensors in the cold"],
)
def test_wrong_swaps_are_caught(kind: type[Ladder], temperature: int) -> None:
    z = scores(2000, 3000, kind)
    assert z[f"temperature {temperature}: occupied sensors"] > 6.0, z


@pytest.mark.slow
def test_every_chain_of_a_ladder_has_its_law_in_a_long_run() -> None:
    z = scores(100_000, 80_000)
    false_alarms = len(z) * 2.0 * stats.t.sf(4.0, N_BATCHES - 1)
    summary = f"seed {SEED}, |z| < 4 fails by chance once in {1 / false_alarms:.0f}: {largest(z)}"
    print(summary, {name: round(score, 2) for name, score in z.items()})
    assert largest(z)[1] < 4.0, summary
    assert np.isfinite(list(z.values())).all()


# Beams asked by levels leave the posterior what it is: one chain against weighted exact draws of the prior.


SPACING, N_SAMPLES, N_EXACT = 100, 60_000, 40_000
LEVELS = 3


def compared(target: Target, exact: Floats, seed: int) -> Floats:
    """z-scores of one chain; the coldest power is the first one."""
    rng = np.random.default_rng(seed)
    chain = make_chain(target, Coloring.empty(WINDOW))
    rows = []
    for step in range(SPACING, (N_SAMPLES + 1) * SPACING, SPACING):
        chain = run_chain(chain, rng, step)
        rows.append(functionals(chain, read_coloring(chain.graph)))
    return z_scores(batch_mean([np.array(rows)], N_BATCHES), exact_means(exact)[0])


@pytest.fixture(scope="module")
def exact() -> Floats:
    return exact_values(blunt_target(), N_EXACT, 5)


@pytest.mark.slow
def test_levels_keep_the_law(exact: Floats) -> None:
    target = blunt_target().with_execution(levels=LEVELS)
    assert make_chain(target, Coloring.empty(WINDOW)).beams.first_beam.shape[1] == LEVELS
    assert np.abs(compared(target, exact, 6)).max() < 4.0


@pytest.mark.slow
def test_a_level_that_does_not_decide_is_seen(exact: Floats) -> None:
    """As if the last level let everything pass."""
    target = blunt_target()
    assert target.laser is not None
    asked = deal_levels(len(target.laser.readings.range), LEVELS) < LEVELS - 1
    readings = target.laser.readings.select(asked)
    deaf = dataclasses.replace(target, laser=dataclasses.replace(target.laser, readings=readings))
    z = np.delete(compared(deaf, exact, 7), 2)  # its sum of log likelihoods is of fewer beams anyway
    assert np.abs(z).max() > 6.0
