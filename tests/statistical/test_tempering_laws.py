"""Every temperature of parallel tempering has its law: the weighted prior; and wrong swaps are caught."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from prf.sampler.tempering import Tempering
from tests.statistical.means import largest, z_scores
from tests.statistical.tempered import (
    N_BATCHES,
    NAMES,
    POWERS,
    Costless,
    Unforbidden,
    blunt_settings,
    exact_means,
    exact_values,
    sampled_means,
)

SEED = 20050726


def scores(n_exact: int, n_swaps: int, kind: type[Tempering] = Tempering) -> dict[str, float]:
    settings = blunt_settings()
    pairs = zip(
        sampled_means(settings, n_swaps, SEED, kind), exact_means(exact_values(settings, n_exact, SEED)), strict=True
    )
    z = [z_scores(found, exact) for found, exact in pairs]
    return {f"temperature {k}: {name}": float(z[k][i]) for k in range(len(POWERS)) for i, name in enumerate(NAMES)}


@pytest.mark.parametrize(("n_exact", "n_swaps"), [(1500, 1500), pytest.param(4000, 6000, marks=pytest.mark.slow)])
def test_every_chain_of_a_ladder_has_its_law(n_exact: int, n_swaps: int) -> None:
    z = scores(n_exact, n_swaps)
    assert len(z) == len(POWERS) * len(NAMES)
    assert largest(z)[1] < 4.5, (SEED, largest(z))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "temperature"),
    [(Costless, 1), (Unforbidden, 0)],
    ids=["swaps without the cost", "black sensors in the cold"],
)
def test_wrong_swaps_are_caught(kind: type[Tempering], temperature: int) -> None:
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
