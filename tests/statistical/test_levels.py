"""Beams asked by levels leave the posterior what it is: one chain against weighted exact draws of the prior."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.kernels.step import run
from prf.model.coloring import Coloring
from prf.model.laser import deal_levels
from prf.model.layout import grow, read_coloring
from prf.sampler.posterior import Settings, make_chain
from tests.statistical.tempered import N_BATCHES, WINDOW, Floats, blunt_settings, exact_means, exact_values, functionals

SPACING, N_SAMPLES, N_EXACT = 100, 60_000, 40_000
LEVELS = 3


def chain_means(settings: Settings, seed: int) -> tuple[Floats, Floats]:
    """Batch means of the functionals and their standard errors."""
    rng = np.random.default_rng(seed)
    chain = make_chain(settings, Coloring.empty(WINDOW))
    rows = []
    for step in range(SPACING, (N_SAMPLES + 1) * SPACING, SPACING):
        while not run(chain, rng, step):
            chain = grow(chain)
        rows.append(functionals(chain, read_coloring(chain.graph)))
    batches = np.array(rows).reshape(N_BATCHES, -1, len(rows[0])).mean(axis=1)
    return batches.mean(axis=0), batches.std(axis=0, ddof=1) / np.sqrt(N_BATCHES)


def z_scores(settings: Settings, exact: Floats, seed: int) -> Floats:
    """The coldest power is the first one."""
    truth = exact_means(exact)
    mean, error = chain_means(settings, seed)
    spread = np.hypot(truth.error[0], error)
    return np.divide(mean - truth.mean[0], spread, out=np.zeros(len(mean)), where=spread > 0.0)


@pytest.fixture(scope="module")
def exact() -> Floats:
    return exact_values(blunt_settings(), N_EXACT, 5)


@pytest.mark.slow
def test_levels_keep_the_law(exact: Floats) -> None:
    settings = dataclasses.replace(blunt_settings(), levels=LEVELS)
    assert make_chain(settings, Coloring.empty(WINDOW)).beams.first_beam.shape[1] == LEVELS
    assert np.abs(z_scores(settings, exact, 6)).max() < 4.0


@pytest.mark.slow
def test_a_level_that_does_not_decide_is_seen(exact: Floats) -> None:
    """As if the last level let everything pass."""
    settings = blunt_settings()
    assert settings.laser is not None
    asked = deal_levels(len(settings.laser.readings.range), LEVELS) < LEVELS - 1
    readings = settings.laser.readings.select(asked)
    deaf = dataclasses.replace(settings, laser=dataclasses.replace(settings.laser, readings=readings))
    z = np.delete(z_scores(deaf, exact, 7), 2)  # its sum of log likelihoods is of fewer beams anyway
    assert np.abs(z).max() > 6.0
