"""Beams asked by levels leave the posterior what it is: one chain against weighted exact draws of the prior."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.model.coloring import Coloring
from prf.model.laser import deal_levels
from prf.model.layout import read_coloring, run_chain
from prf.sampler.posterior import Settings, make_chain
from tests.statistical.means import Floats, batch_mean, z_scores
from tests.statistical.tempered import N_BATCHES, WINDOW, blunt_settings, exact_means, exact_values, functionals

SPACING, N_SAMPLES, N_EXACT = 100, 60_000, 40_000
LEVELS = 3


def compared(settings: Settings, exact: Floats, seed: int) -> Floats:
    """z-scores of one chain; the coldest power is the first one."""
    rng = np.random.default_rng(seed)
    chain = make_chain(settings, Coloring.empty(WINDOW))
    rows = []
    for step in range(SPACING, (N_SAMPLES + 1) * SPACING, SPACING):
        chain = run_chain(chain, rng, step)
        rows.append(functionals(chain, read_coloring(chain.graph)))
    return z_scores(batch_mean([np.array(rows)], N_BATCHES), exact_means(exact)[0])


@pytest.fixture(scope="module")
def exact() -> Floats:
    return exact_values(blunt_settings(), N_EXACT, 5)


@pytest.mark.slow
def test_levels_keep_the_law(exact: Floats) -> None:
    settings = dataclasses.replace(blunt_settings(), levels=LEVELS)
    assert make_chain(settings, Coloring.empty(WINDOW)).beams.first_beam.shape[1] == LEVELS
    assert np.abs(compared(settings, exact, 6)).max() < 4.0


@pytest.mark.slow
def test_a_level_that_does_not_decide_is_seen(exact: Floats) -> None:
    """As if the last level let everything pass."""
    settings = blunt_settings()
    assert settings.laser is not None
    asked = deal_levels(len(settings.laser.readings.range), LEVELS) < LEVELS - 1
    readings = settings.laser.readings.select(asked)
    deaf = dataclasses.replace(settings, laser=dataclasses.replace(settings.laser, readings=readings))
    z = np.delete(compared(deaf, exact, 7), 2)  # its sum of log likelihoods is of fewer beams anyway
    assert np.abs(z).max() > 6.0
