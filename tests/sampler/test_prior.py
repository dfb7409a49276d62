"""Draws from the prior by the chain: spacing, burn-in, seeds. Their laws are looked at in tests/statistical."""

from __future__ import annotations

import numpy as np
import pytest

from prf.model.coloring import Draws, violations
from prf.model.window import Window
from prf.sampler import mcmc_draws
from prf.sampler.prior import BURN_IN_DRAWS, chosen_thin
from prf.shell.errors import ConfigError

UNIT = Window(0.0, 0.0, 1.0, 1.0)


def same(one: Draws, two: Draws) -> bool:
    return np.array_equal(one.xy, two.xy) and np.array_equal(one.edges, two.edges)


def test_draws_are_valid_and_repeat_with_their_seed() -> None:
    draws, thin = mcmc_draws(1.0, UNIT, 50, seed=3)
    assert len(draws) == 50
    assert thin == chosen_thin(1.0, UNIT)
    assert not any(violations(coloring) for coloring in draws)
    assert same(draws, mcmc_draws(1.0, UNIT, 50, seed=3)[0])
    assert not same(draws, mcmc_draws(1.0, UNIT, 50, seed=4)[0])


def test_the_first_draw_knows_nothing_of_the_spacing() -> None:
    close, thin = mcmc_draws(1.0, UNIT, 3, thin=300, seed=5)
    wide, twice = mcmc_draws(1.0, UNIT, 1, thin=600, seed=5)
    assert (thin, twice) == (300, 600)
    assert same(Draws.from_colorings([close[0]]), wide)
    assert not same(Draws.from_colorings([close[1]]), wide)


def test_the_spacing_grows_with_the_edges_to_be_expected() -> None:
    assert chosen_thin(1.0, UNIT) == 1329
    assert chosen_thin(0.4, Window(0.0, 0.0, 10.0, 10.0)) == 11_354
    assert BURN_IN_DRAWS >= 20


@pytest.mark.slow
def test_the_white_start_is_forgotten() -> None:
    """The very first draw of many seeds: half of the centres are black, and edges are as many as the law says."""
    first = [mcmc_draws(1.0, UNIT, 1, seed=seed)[0] for seed in range(60)]
    z_black = (np.mean([draws.anchor_black[0] for draws in first]) - 0.5) / np.sqrt(0.25 / 60)
    edges = np.array([draws.n_edges[0] for draws in first])
    z_edges = (edges.mean() - (4.0 + 4.0 * np.pi)) / (edges.std(ddof=1) / np.sqrt(60))
    assert abs(z_black) < 4.0
    assert abs(z_edges) < 4.0


def test_no_draws_and_a_wrong_scale() -> None:
    assert len(mcmc_draws(1.0, UNIT, 0)[0]) == 0
    with pytest.raises(ConfigError):
        mcmc_draws(0.0, UNIT, 3)
