from __future__ import annotations

import numpy as np
import pytest

from mapq.kernels.normals import estimate_normals, robust_normals, trimmed_residuals
from mapq.segmentation.sample import pooled_noise, usual_noise
from tests.reference.mapq_segment import nearest, plane_of, wall

RNG = np.random.default_rng(6)


def normals(xyz: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normal, spread = np.empty((len(xyz), 3), np.float32), np.empty((len(xyz), 3), np.float32)
    estimate_normals(xyz, np.arange(len(xyz)), neighbours.astype(np.int32), normal, spread)
    return normal, spread


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_normals_are_those_of_an_eigen_decomposition(scale: float) -> None:
    xyz = scale * (RNG.normal(0, 1, (300, 3)) * (3.0, 1.0, 0.2) + 50.0)
    found = nearest(xyz, 16)
    normal, spread = normals(xyz, found)
    for i in range(len(xyz)):
        expected, variances = plane_of(xyz[[i, *found[i]]])
        assert abs(normal[i] @ expected) == pytest.approx(1.0, abs=1e-5)
        np.testing.assert_allclose(spread[i], variances, rtol=1e-4, atol=1e-6 * scale**2)


def test_a_plane_without_noise_is_found_exactly() -> None:
    xyz = wall(RNG, noise=0.0, degrees=30.0)[:400]
    normal, spread = normals(xyz, nearest(xyz, 16))
    np.testing.assert_allclose(np.abs(normal @ [-0.5, np.sqrt(0.75), 0.0]), 1.0, atol=1e-6)
    assert spread[:, 0].max() < 1e-12


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 0, 1), (1, 1, 1), (1, -2, 3)])
def test_a_line_has_a_normal_across_it(direction: tuple[int, int, int]) -> None:
    along = np.array(direction) / np.linalg.norm(direction)
    xyz = RNG.uniform(0, 1, (60, 1)) * along
    normal, _ = normals(xyz, nearest(xyz, 16))
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(normal @ along, 0.0, atol=1e-5)


def test_a_point_with_one_neighbour_has_no_normal() -> None:
    normal, spread = normals(np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[1, -1, -1], [0, -1, -1]]))
    assert np.isnan(normal).all()
    assert np.isnan(spread).all()


@pytest.mark.parametrize("offset", [0.15, 0.3])
def test_robust_normals_between_two_copies_of_a_wall(offset: float) -> None:
    xyz = np.vstack([wall(RNG, 5, 4), wall(RNG, 5, 4, offset=offset)])
    found = nearest(xyz, 16).astype(np.int32)
    normal, spread = normals(xyz, found)
    plain = np.abs(normal[:, 1]) > np.cos(np.radians(15))
    variance = spread[:, 0].copy()
    robust_normals(xyz, np.ones(len(xyz), bool), found, 28, 28, 0.05, 0.3, normal, variance)
    robust = np.abs(normal[:, 1]) > np.cos(np.radians(15))
    assert robust.mean() > max(0.6, 1.1 * plain.mean())


def test_a_ball_has_few_robust_normals() -> None:
    xyz = RNG.uniform(0, 1, (900, 3))
    found = nearest(xyz, 16).astype(np.int32)
    normal, spread = normals(xyz, found)
    robust_normals(xyz, np.ones(len(xyz), bool), found, 28, 28, 0.005, 0.3, normal, spread[:, 0].copy())
    assert np.isfinite(normal[:, 0]).mean() < 0.2


@pytest.mark.parametrize(
    ("parts", "noise"),
    [
        ([wall(RNG)], 0.02),
        ([wall(RNG), wall(RNG, offset=0.15)], 0.02),
        ([wall(RNG, noise=0.03), wall(RNG, noise=0.03, offset=0.2)], 0.03),
        ([wall(RNG, noise=0.0), wall(RNG, noise=0.0, offset=0.15)], 0.0),
    ],
)
def test_noise_is_that_of_one_copy(parts: list[np.ndarray], noise: float) -> None:
    xyz = np.concatenate(parts)[RNG.permutation(sum(map(len, parts)))]
    sample = np.arange(0, len(xyz), 8)
    found = np.array([np.argsort(((xyz - xyz[i]) ** 2).sum(axis=1), kind="stable")[1:49] for i in sample])
    scale, thickness = np.empty(len(sample)), np.empty(len(sample))
    residual = np.empty((len(sample), 49))
    trimmed_residuals(xyz, sample, found.astype(np.int32), 28, scale, thickness, residual)
    for estimate in (pooled_noise, usual_noise):
        assert estimate(scale, residual) == pytest.approx(noise, rel=0.3, abs=1e-9)


def test_noise_of_nothing_is_none() -> None:
    assert pooled_noise(np.full(3, np.nan), np.full((3, 5), np.nan)) == 0.0
    assert usual_noise(np.full(3, np.nan), np.full((3, 5), np.nan)) == 0.0
