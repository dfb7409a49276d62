from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.map_metrics import map_metrics
from mapq.cloud import PointCloud
from prf.shell.errors import UsageError


def cloud_of(xyz: np.ndarray) -> PointCloud:
    return PointCloud(np.asarray(xyz, np.float64), np.zeros(3))


def sheet(n: int = 4000, noise: float = 0.02, double: float = 0.0, seed: int = 1) -> np.ndarray:
    """A level square of 5 m, half of whose points lie `double` metres higher."""
    rng = np.random.default_rng(seed)
    z = rng.normal(0.0, noise, n) + double * (np.arange(n) % 2)
    return np.column_stack([rng.uniform(0, 5, (n, 2)), z])


def by_definition(xyz: np.ndarray, radius: float) -> tuple[float, float]:
    """Both means, point by point."""
    entropy, variance = [], []
    for point in xyz:
        near = xyz[np.linalg.norm(xyz - point, axis=1) <= radius]
        if len(near) >= 5:
            sigma = np.cov(near.T)
            entropy.append(0.5 * np.log(np.linalg.det(2 * np.pi * np.e * sigma)))
            variance.append(np.linalg.eigvalsh(sigma)[0])
    return float(np.mean(entropy)), float(np.mean(variance))


@pytest.mark.parametrize("radius", [0.3, 0.8])
def test_it_is_the_definition(radius):
    xyz = sheet(600)
    found = map_metrics(cloud_of(xyz), radius)
    assert (found.mean_map_entropy, found.mean_plane_variance) == pytest.approx(by_definition(xyz, radius), rel=1e-9)


def test_a_doubled_surface_has_more_of_both():
    clean, double = (map_metrics(cloud_of(sheet(double=d))) for d in (0.0, 0.2))
    assert clean.mean_map_entropy < double.mean_map_entropy
    assert clean.mean_plane_variance == pytest.approx(0.02**2, rel=0.1)
    assert double.mean_plane_variance == pytest.approx(0.1**2 + 0.02**2, rel=0.1)


def test_order_shift_and_missing_points_change_nothing():
    xyz = sheet()
    found = map_metrics(cloud_of(xyz))
    order = np.random.default_rng(2).permutation(len(xyz))
    assert map_metrics(cloud_of(np.vstack([xyz[order], np.full((3, 3), np.nan)]))) == found
    far = replace(cloud_of(xyz), shift=np.array([5e5, 5e6, 0.0]))
    assert map_metrics(far) == found


def test_a_sample_stands_for_all(monkeypatch):
    from benchmarks import map_metrics as metrics

    every = map_metrics(cloud_of(sheet()))
    monkeypatch.setattr(metrics, "SAMPLE", 500)
    some = map_metrics(cloud_of(sheet()))
    assert (every.n_asked, some.n_asked, some.n_points) == (4000, 500, 4000)
    assert some.mean_map_entropy == pytest.approx(every.mean_map_entropy, abs=0.05)


@pytest.mark.parametrize("xyz", [np.zeros((0, 3)), np.zeros((9, 3)), np.eye(3), sheet(noise=0.0)])
def test_what_has_no_entropy_is_nan(xyz):
    found = map_metrics(cloud_of(xyz))
    assert np.isnan(found.mean_map_entropy)
    assert np.isnan(found.mean_plane_variance)
    assert found.n_used == 0


@pytest.mark.parametrize("radius", [0.0, -1.0, float("nan"), float("inf")])
def test_a_radius_that_is_none(radius):
    with pytest.raises(UsageError, match="above 0"):
        map_metrics(cloud_of(sheet(50)), radius)
