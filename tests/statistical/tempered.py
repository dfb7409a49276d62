"""Rungs of parallel tempering on readings that say little, against weighted exact draws of the prior.

``python -m tests.statistical.tempered STEPS N_EXACT SEED`` prints the z-score of every mean on every rung as JSON.
"""

from __future__ import annotations

import json
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import prf
from prf.arak import exact_draws
from prf.coloring import Coloring, black_at
from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.layout import read_coloring
from prf.posterior import LaserData, Settings, make_chain
from prf.sampler.tempering import SWAP_SPACING, Tempering
from prf.sampler.tempering_ladder import LadderPlan
from prf.sampler.tempering_state import with_map
from prf.sensors.laser import LaserModel
from prf.window import Window

Floats = NDArray[np.float64]

WINDOW = Window(0.0, 0.0, 4.0, 4.0)
SCALE = 0.3
SENSORS = np.array([[1.1, 1.3], [2.9, 2.4]])
COST = 2.0
N_BATCHES = 50
BURN_IN = 100
"""Tries to swap that are left out."""
NAMES = ("edges", "length", "log likelihood", "occupied sensors", "black at (2.9, 0.9)", "black at (0.4, 3.2)")


def blunt_settings() -> Settings:
    """Six beams of an unsure laser, which a wall right of both sensors and nothing on the left would explain."""
    angle = np.tile([0.0, 0.5 * np.pi, np.pi], 2)
    readings = np.array([0.9, 1.5, np.inf, 0.6, np.inf, 1.0])
    model = LaserModel(3.0, noise=0.4, outlier_probability=0.4, miss_probability=0.1)
    return Settings(WINDOW, SCALE, LaserData(np.repeat(SENSORS, 3, axis=0), angle, readings, model))


def functionals(chain: Chain, coloring: Coloring) -> list[float]:
    sums = chain.graph.sums
    black = black_at(coloring, [[2.9, 0.9], [0.4, 3.2]]).astype(float).tolist()
    occupied = float(black_at(coloring, SENSORS).sum())
    return [float(coloring.n_edges), float(coloring.total_length()), float(sums[c.LOG_LIKELIHOOD]), occupied, *black]


def exact_values(settings: Settings, n: int, seed: int) -> Floats:
    """Functionals (n, len(NAMES)) of exact draws of the prior."""
    chain = make_chain(settings, Coloring.empty(WINDOW))
    rows = []
    for draw in exact_draws(SCALE, WINDOW, n, np.random.default_rng(seed)):
        chain = with_map(chain, settings, draw)
        rows.append(functionals(chain, draw))
    return np.array(rows)


class Means(NamedTuple):
    """Means of the functionals on every rung, (rungs, len(NAMES)), and their standard errors."""

    mean: Floats
    error: Floats


def exact_means(values: Floats, powers: Floats) -> Means:
    """Self-normalised importance sampling; on the cold rung no sensor may be occupied."""
    log_likelihood, occupied = values[:, 2], values[:, 3]
    means, errors = [], []
    for k, power in enumerate(powers):
        weight = np.exp(power * (log_likelihood - log_likelihood.max() - COST * occupied))
        if k == 0:
            weight = np.where(occupied > 0, 0.0, np.exp(log_likelihood - log_likelihood.max()))
        weight /= weight.sum()
        mean = weight @ values
        means.append(mean)
        errors.append(np.sqrt(weight**2 @ (values - mean) ** 2))
    return Means(np.array(means), np.array(errors))


def sampled_means(settings: Settings, steps: int, powers: Floats, seed: int) -> Means:
    """Batch means over one run at fixed powers."""
    rng = np.random.default_rng(seed)
    cold = make_chain(settings, Coloring.empty(WINDOW))
    tempering = Tempering(settings, cold, rng, LadderPlan(len(powers), 0.0, COST))
    tempering.ladder.powers[:] = powers
    tempering.apply_powers()
    rows = []
    for step in range(SWAP_SPACING, steps + 1, SWAP_SPACING):
        cold = tempering.run_to(cold, rng, step)
        if step % 50 * SWAP_SPACING == 0:
            tempering.settle()
        rows.append([functionals(chain, read_coloring(chain.graph)) for chain in (cold, *tempering.hot)])
    kept = np.array(rows[BURN_IN:])
    batches = kept[: len(kept) // N_BATCHES * N_BATCHES].reshape(N_BATCHES, -1, *kept.shape[1:]).mean(axis=1)
    return Means(batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(N_BATCHES))


POWERS = np.array([1.0, 0.6, 0.25, 0.0])


def z_scores(steps: int, n_exact: int, seed: int) -> dict[str, float]:
    settings = blunt_settings()
    exact = exact_means(exact_values(settings, n_exact, seed), POWERS)
    found = sampled_means(settings, steps, POWERS, seed)
    error = np.hypot(exact.error, found.error)
    z = np.where(error > 0.0, (found.mean - exact.mean) / np.where(error > 0.0, error, 1.0), 0.0)
    return {f"rung {k}: {name}": float(z[k, i]) for k in range(len(POWERS)) for i, name in enumerate(NAMES)}


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:4]]
    print(json.dumps({"package": prf.__file__, "z": z_scores(*numbers)}))
