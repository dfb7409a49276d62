from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mapq.cloud import PointCloud
from mapq.segmentation.points import sort_points
from mapq.segmentation.sample import neighbours_of
from tests.reference.mapq_segment import nearest, wall

RNG = np.random.default_rng(5)
CLOUDS = {
    "volume": RNG.uniform(0, 1, (1500, 3)),
    "outliers": np.vstack([RNG.uniform(0, 1, (1500, 3)), RNG.uniform(-300, 300, (40, 3))]),
    "grid, full of ties": RNG.integers(0, 8, (900, 3)).astype(float),
    "line": np.column_stack([np.arange(400.0) * 0.01, np.zeros((400, 2))]),
    "six decades": 10.0 ** RNG.uniform(-5, 1, (1200, 3)),
    "fewer than k": RNG.normal(0, 1, (6, 3)),
    "one": np.zeros((1, 3)),
    "two far apart": np.array([[0.0, 0, 0], [1e6, 0, 0]]),
    "dense clump and sparse rest": np.vstack([RNG.normal(0, 1e-6, (1200, 3)), RNG.uniform(-5, 5, (300, 3))]),
}


def search(xyz: np.ndarray, k: int, max_gap: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
    points = sort_points(PointCloud(xyz, np.zeros(3)))
    everyone = np.ones(len(points.xyz), bool)
    return points.xyz, neighbours_of(points.xyz, points.code, points.frame, everyone, k, max_gap)


@pytest.mark.parametrize("k", [3, 16])
@pytest.mark.parametrize("name", CLOUDS)
def test_neighbours_are_exact_and_ties_go_by_number(name: str, k: int) -> None:
    xyz, found = search(CLOUDS[name], k)
    np.testing.assert_array_equal(found, nearest(xyz, k)[:, :k])


@pytest.mark.parametrize("name", ["volume", "grid, full of ties", "outliers"])
def test_a_gap_cuts_the_lists(name: str) -> None:
    xyz, found = search(CLOUDS[name], 16, 0.1 if name != "grid, full of ties" else 1.0)
    np.testing.assert_array_equal(found, nearest(xyz, 16, 0.1 if name != "grid, full of ties" else 1.0))


def test_a_large_cloud_agrees_with_a_tree() -> None:
    xyz, found = search(np.vstack([wall(RNG, 30, 10, 0.1), wall(RNG, 30, 10, 0.03, offset=5)]), 16)
    distance = np.linalg.norm(xyz[found] - xyz[:, None], axis=2)
    np.testing.assert_allclose(distance, cKDTree(xyz).query(xyz, 17)[0][:, 1:], rtol=1e-12)


def test_only_chosen_points_get_a_row() -> None:
    points = sort_points(PointCloud(CLOUDS["volume"], np.zeros(3)))
    wanted = RNG.uniform(size=len(points.xyz)) < 0.1
    found = neighbours_of(points.xyz, points.code, points.frame, wanted, 16)
    np.testing.assert_array_equal(found, nearest(points.xyz, 16)[wanted])
