"""Adaptive importance sampling against integrals of normals, which have a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from prf.results.score.importance import Floats, Ints, integrate, pooled


@pytest.mark.parametrize("deviation", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("is_known", [False, True])
def test_normals_narrow_and_wide(deviation: float, is_known: bool) -> None:
    rng = np.random.default_rng(4)
    n, mixing = 40, rng.normal(size=(3, 3))
    scale = deviation * mixing @ mixing.T / np.linalg.norm(mixing @ mixing.T)
    covariance = scale @ scale + (0.2 * deviation) ** 2 * np.eye(3)
    middle = 1.3 * rng.normal(size=(n, 3))

    def target(scans: Ints, errors: Floats) -> Floats:
        away = errors - middle[scans]
        return np.asarray(-0.5 * np.einsum("kni,ij,knj->kn", away, np.linalg.inv(covariance), away))

    found = integrate(target, n, None, 30.0, rng)
    if is_known:
        found = integrate(target, n, pooled([found.posterior]), 30.0, rng)
    total = np.eye(3) + covariance
    quadratic = np.einsum("ni,ij,nj->n", middle, np.linalg.inv(total), middle)
    expected = 0.5 * (np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(total)[1] - quadratic)
    error = found.log_value - expected
    assert abs(error.mean()) < 0.08
    assert error.std() < 0.35
    assert found.ess.min() >= 30.0
    spread = covariance @ np.linalg.inv(total)
    away = found.posterior.mean - middle @ np.linalg.inv(total)
    assert np.sqrt((away**2).mean() / np.trace(spread) * 3.0) < 0.3
    assert np.trace(found.posterior.covariance, axis1=1, axis2=2).mean() == pytest.approx(np.trace(spread), rel=0.2)
