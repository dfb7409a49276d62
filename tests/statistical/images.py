"""One posterior by two samplers that share nothing: occupancy images agree within their Monte Carlo errors.

The other sampler is that of disagreement loops (``tests/reference/disagreement_loops.py``), with the likelihood of the
slow oracles. Errors come from effective sample sizes over independent chains that start from different maps.
"""

from __future__ import annotations

import itertools
import time
from typing import NamedTuple

import numpy as np
from scipy import stats

from prf.model.coloring import Draws, black_at_draws
from prf.model.window import Window
from prf.results.convergence import diagnose
from prf.sampler import Ensemble
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Target
from prf.shell.cli.console import progress
from tests.driving import advance
from tests.reference.disagreement_loops import sample
from tests.statistical.check import Check
from tests.statistical.means import Floats, Mean, z_scores
from tests.statistical.problems import Station, from_map

N_CELLS = 14
"""Along a side of the images."""
CONFIDENCE = 0.99
MOST_RHAT, LEAST_ESS = 1.05, 200
BURN_IN = 0.1
SPACING = 10
"""Loops between two maps that are kept."""
FOLLOWED = ("number of edges", "length", "black area")
"""What is compared besides the image."""


class Estimate(NamedTuple):
    """What a sampler says.

    Attributes
    ----------
    mean, error : (N_CELLS**2 + len(FOLLOWED),) arrays
        Of the colours of the cells' middles, the lowest row first, then of what is followed.
    rhat : float
        The worst.
    ess : float
        The smallest.
    seconds : float
    """

    mean: Floats
    error: Floats
    rhat: float
    ess: float
    seconds: float

    @property
    def image(self) -> Floats:
        """Share of draws in which cells are black, (N_CELLS, N_CELLS)."""
        return self.mean[: N_CELLS**2].reshape(N_CELLS, N_CELLS)


class Comparison(NamedTuple):
    """z-scores of the differences, and the limit that all keep at once."""

    z: Floats
    limit: float


def middles(window: Window) -> Floats:
    """Return the middles of the cells, (N_CELLS**2, 2)."""
    share = (np.arange(N_CELLS) + 0.5) / N_CELLS
    x, y = np.meshgrid(window.x_min + share * window.width, window.y_min + share * window.height)
    return np.column_stack([x.ravel(), y.ravel()])


def looked_at(draws: Draws) -> Floats:
    """Return colours and what is followed, (n_draws, N_CELLS**2 + len(FOLLOWED))."""
    shape = from_map(draws)[:, : len(FOLLOWED)]
    return np.column_stack([black_at_draws(draws, middles(draws.window)).astype(np.float64), shape])


def estimate(values: Floats, seconds: float) -> Estimate:
    """Return means over chains (n_chains, n_draws, k), and their errors by effective sample sizes."""
    flat = values.reshape(-1, values.shape[2])
    found = diagnose({str(k): values[:, :, k] for k in range(values.shape[2])}, draws_per_chain=values.shape[1])
    varying = [one for one in found.values() if one.state != "constant"]
    ess = np.array([one.ess if one.state != "constant" else np.inf for one in found.values()])
    error = flat.std(axis=0, ddof=1) / np.sqrt(ess)
    worst = max((one.rhat for one in varying), default=1.0)
    return Estimate(flat.mean(axis=0), error, worst, float(min((one.ess for one in varying), default=np.inf)), seconds)


def by_loops(station: Station, target: Target, n_chains: int, steps: int, seed: int) -> Estimate:
    """Sample by disagreement loops, each chain from a draw of the prior."""
    start, kept = time.monotonic(), []
    with progress(n_chains * steps, "disagreement loops") as reporter:
        for number in range(n_chains):
            rng = np.random.default_rng([seed, 1, number])
            chain = sample(
                station.draw_map(rng),
                target.scale,
                lambda coloring: station.log_likelihood(target, coloring),
                tuple(station.sensors[0].tolist()),
                rng,
            )
            maps = []
            for step, coloring in enumerate(itertools.islice(chain, steps)):
                if step >= BURN_IN * steps and step % SPACING == 0:
                    maps.append(coloring)
                    reporter(number * steps + step)
            kept.append(looked_at(Draws.from_colorings(maps)))
    return estimate(np.array(kept), time.monotonic() - start)


def by_sampler(target: Target, plan: LadderPlan | None, n_chains: int, steps: int, seed: int, threads: int) -> Estimate:
    """Sample as ``prf sample`` does."""
    start = time.monotonic()
    generators = [np.random.default_rng([seed, 2, number]) for number in range(n_chains)]
    sampler = Ensemble(target, generators, plan=plan)
    with progress(steps, "the sampler") as reporter:
        while sampler.step < steps:
            advance(sampler, threads)
            reporter(sampler.step)
    found = sampler.sample()
    values = looked_at(found.draws)
    return estimate(np.array([values[found.chain == k] for k in range(n_chains)]), time.monotonic() - start)


def compare(first: Estimate, second: Estimate) -> Comparison:
    """Return how far two estimates are apart; the limit is Bonferroni's, for normal errors."""
    z = z_scores(Mean(second.mean, second.error), Mean(first.mean, first.error))
    return Comparison(z, float(stats.norm.isf(0.5 * (1.0 - CONFIDENCE) / len(z))))


def image_check(name: str, first: Estimate, second: Estimate, is_control: bool = False) -> Check:
    """Return the check that two samplers agree."""
    found = compare(first, second)
    error = np.hypot(first.error, second.error)[: N_CELLS**2]
    statistic = (
        f"largest |z| {np.abs(found.z).max():.2f}, mean z^2 {np.mean(found.z**2):.2f} over {N_CELLS}x{N_CELLS} cells "
        f"and {len(FOLLOWED)} means; errors up to {error.max():.4f}, R-hat {max(first.rhat, second.rhat):.3f}"
    )
    band = f"|z| < {found.limit:.2f}, {CONFIDENCE:.0%} for all at once"
    return Check(name, statistic, band, bool(np.abs(found.z).max() < found.limit), second.seconds, is_control)


def mixing_check(name: str, found: Estimate) -> Check:
    """Return the check that chains agree: only then do their errors mean anything."""
    statistic = f"worst R-hat {found.rhat:.3f}, smallest ESS {found.ess:.0f}"
    inside = found.rhat < MOST_RHAT and found.ess > LEAST_ESS
    return Check(f"{name}: mixing", statistic, f"< {MOST_RHAT}, > {LEAST_ESS}", inside, found.seconds)
