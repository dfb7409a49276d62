"""Temperatures of parallel tempering on readings that say little, against weighted exact draws of the prior.

Weights say exactly what the law at every temperature is; where they are not too uneven, draws of the prior are draws
of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.laser import LaserModel
from prf.model.layout import read_coloring
from prf.model.window import Window
from prf.sampler.chain_map import with_map
from prf.sampler.posterior import LaserData, Settings, make_chain
from prf.sampler.tempering import LadderPlan, Tempering

Floats = NDArray[np.float64]

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


def blunt_settings() -> Settings:
    """Six beams of an unsure laser."""
    angle = np.tile([0.0, 0.5 * np.pi, np.pi], 2)
    readings = np.array([0.9, 1.5, np.inf, 0.6, np.inf, 1.0])
    model = LaserModel(3.0, noise=0.4, outlier_probability=0.4, miss_probability=0.1)
    return Settings(WINDOW, SCALE, LaserData.from_arrays(np.repeat(SENSORS, 3, axis=0), angle, readings, model))


def functionals(chain: Chain, coloring: Coloring) -> list[float]:
    black = black_at(coloring, np.concatenate([SENSORS, PLACES])).astype(float)
    log_likelihood = float(chain.graph.sums[c.LOG_LIKELIHOOD])
    return [coloring.n_edges, coloring.total_length(), log_likelihood, black[:2].sum(), *black[2:]]


def exact_values(settings: Settings, n: int, seed: int) -> Floats:
    """Functionals (n, len(NAMES)) of exact draws of the prior."""
    chain = make_chain(settings, Coloring.empty(WINDOW))
    rows = []
    for draw in exact_draws(SCALE, WINDOW, n, np.random.default_rng(seed)):
        chain = with_map(chain, settings, draw)
        rows.append(functionals(chain, draw))
    return np.array(rows)


class Means(NamedTuple):
    """Means of the functionals on every temperature, (temperatures, len(NAMES)), and their standard errors."""

    mean: Floats
    error: Floats


def exact_means(values: Floats) -> Means:
    """Self-normalised importance sampling; on the cold chain no sensor may be occupied."""
    log_likelihood, occupied = values[:, 2] - values[:, 2].max(), values[:, 3]
    means, errors = [], []
    for power in POWERS:
        log_weight = power * (log_likelihood - COST * occupied)
        if power == 1.0:
            log_weight = np.where(occupied > 0, -np.inf, log_likelihood)
        weight = np.exp(log_weight)
        weight /= weight.sum()
        mean = weight @ values
        means.append(mean)
        errors.append(np.sqrt(weight**2 @ (values - mean) ** 2))
    return Means(np.array(means), np.array(errors))


class Costless(Tempering):
    """The mistake: swaps forget what occupied sensors cost."""

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        log_ratio = super().log_swap_ratio(pair, colder, hotter)
        counts = [chain.graph.counts[c.OCCUPIED] for chain in (hotter, colder)]
        powers = self.ladder.powers
        return log_ratio + float((powers[pair] - powers[pair + 1]) * self.cost * (counts[0] - counts[1]))


class Unforbidden(Tempering):
    """The mistake: a map with an occupied sensor may come to the cold chain, at the cost that the others ask."""

    def log_swap_ratio(self, pair: int, colder: Chain, hotter: Chain) -> float:
        log_ratio = super().log_swap_ratio(pair, colder, hotter)
        if log_ratio > -np.inf:
            return log_ratio
        sums = [chain.graph.sums[c.LOG_LIKELIHOOD] for chain in (hotter, colder)]
        cost = self.cost * hotter.graph.counts[c.OCCUPIED]
        return float((self.ladder.powers[0] - self.ladder.powers[1]) * (sums[0] - cost - sums[1]))


def sampled_means(settings: Settings, n_swaps: int, seed: int, kind: type[Tempering] = Tempering) -> Means:
    """Batch means over one run at fixed powers, looked at after every try to swap."""
    rng = np.random.default_rng(seed)
    cold = make_chain(settings, Coloring.empty(WINDOW))
    tempering = kind(settings, cold, rng, LadderPlan(len(POWERS), 0.0, COST))
    tempering.spacing = SPACING
    tempering.ladder.powers[:] = POWERS
    tempering.apply_powers()
    rows = []
    for swap in range(1, n_swaps + 1):
        cold = tempering.run_to(cold, rng, swap * SPACING)
        if swap > BURN_IN:
            rows.append([functionals(chain, read_coloring(chain.graph)) for chain in (cold, *tempering.hot)])
    kept = np.array(rows)
    batches = kept[: len(kept) // N_BATCHES * N_BATCHES].reshape(N_BATCHES, -1, *kept.shape[1:]).mean(axis=1)
    return Means(batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(N_BATCHES))


def z_scores(exact: Means, found: Means) -> dict[str, float]:
    """z-score of every mean on every temperature; 0 where both are the same without any error."""
    error = np.hypot(exact.error, found.error)
    difference = found.mean - exact.mean
    z = np.where(difference == 0.0, 0.0, difference / np.where(error > 0.0, error, 1e-300))
    return {f"temperature {k}: {name}": float(z[k, i]) for k in range(len(POWERS)) for i, name in enumerate(NAMES)}
