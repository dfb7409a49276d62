from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.cloud import PointCloud
from mapq.kernels.cells import LEVELS, first_levels, number_cells, pick_one_a_cell, sort_codes
from mapq.kernels.growing import pair_rms
from mapq.kernels.normals import estimate_normals, robust_normals, trimmed_residuals
from mapq.kernels.order_statistics import quantiles
from mapq.segmentation.points import neighbours_of, pooled_noise, sort_points, usual_noise
from mapq.segmentation.regions import fit
from tests.reference.mapq_segment import nearest, plane_of, wall

RNG = np.random.default_rng(7)


def slow_number(cell: np.ndarray) -> int:
    """Interleave the bits of a cell's three indices, x above y above z."""
    return sum(((int(cell[axis]) >> bit) & 1) << (3 * bit + 2 - axis) for bit in range(LEVELS) for axis in range(3))


def test_numbers_interleave_the_bits_of_the_indices() -> None:
    cells = RNG.integers(0, 1 << LEVELS, (200, 3))
    numbers = number_cells((cells + 0.5) / (1 << LEVELS), np.zeros(3), 1.0)
    assert numbers.tolist() == [slow_number(cell) for cell in cells]


def test_first_levels_count_the_cells_of_every_level() -> None:
    code = np.sort(number_cells(RNG.uniform(0, 1, (3000, 3)), np.zeros(3), 1.0))
    first = first_levels(np.repeat(code, 2))
    for level in range(LEVELS + 1):
        n_cells = len(np.unique(code >> np.uint64(3 * (LEVELS - level))))
        assert np.count_nonzero(first <= level) == n_cells
    assert np.count_nonzero(first > LEVELS) == len(code)


@pytest.mark.parametrize("bits", [3, 30, 63])
def test_codes_are_sorted_and_equal_ones_stay_in_their_order(bits: int) -> None:
    code = RNG.integers(0, 1 << bits, 3000).astype(np.uint64)
    ordered, order = sort_codes(code)
    np.testing.assert_array_equal(order, np.argsort(code, kind="stable"))
    np.testing.assert_array_equal(ordered, code[order])


def test_one_point_a_cell_and_not_always_the_first() -> None:
    code = np.sort(number_cells(RNG.uniform(0, 1, (3000, 3)), np.zeros(3), 1.0))
    picked = pick_one_a_cell(code, first_levels(code), 3)
    cells = code >> np.uint64(3 * (LEVELS - 3))
    np.testing.assert_array_equal(cells[picked], np.unique(cells))
    rank = picked - np.searchsorted(cells, cells[picked])
    assert 0 < np.mean(rank == 0) < 0.5


GROWING_RNG = np.random.default_rng(8)


def joined(*parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate(parts), np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])


def all_pairs(n: int) -> np.ndarray:
    return np.array([(i, j) for i in range(n) for j in range(i + 1, n)], np.int32)


def test_joint_residuals_are_those_of_the_joint_plane() -> None:
    xyz, region = joined(wall(GROWING_RNG), wall(GROWING_RNG, 3, 2, offset=0.1, start=4, degrees=3))
    fits = fit(xyz, region)
    rms = pair_rms(all_pairs(2), np.arange(2, dtype=np.int32), fits.origin, fits.sums)
    normal, _ = plane_of(xyz)
    distance = (xyz - xyz.mean(axis=0)) @ normal
    expected = max(np.sqrt((distance[region == r] ** 2).mean()) for r in range(2))
    assert rms[0] == pytest.approx(expected, rel=1e-6)


NEIGHBOURS_RNG = np.random.default_rng(5)
CLOUDS = {
    "volume": NEIGHBOURS_RNG.uniform(0, 1, (1500, 3)),
    "outliers": np.vstack([NEIGHBOURS_RNG.uniform(0, 1, (1500, 3)), NEIGHBOURS_RNG.uniform(-300, 300, (40, 3))]),
    "grid, full of ties": NEIGHBOURS_RNG.integers(0, 8, (900, 3)).astype(float),
    "line": np.column_stack([np.arange(400.0) * 0.01, np.zeros((400, 2))]),
    "six decades": 10.0 ** NEIGHBOURS_RNG.uniform(-5, 1, (1200, 3)),
    "fewer than k": NEIGHBOURS_RNG.normal(0, 1, (6, 3)),
    "one": np.zeros((1, 3)),
    "two far apart": np.array([[0.0, 0, 0], [1e6, 0, 0]]),
    "nearly equal distances": NEIGHBOURS_RNG.integers(0, 8, (900, 3)) + NEIGHBOURS_RNG.normal(0, 1e-9, (900, 3)),
    "dense clump and sparse rest": np.vstack(
        [NEIGHBOURS_RNG.normal(0, 1e-6, (1200, 3)), NEIGHBOURS_RNG.uniform(-5, 5, (300, 3))]
    ),
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


def test_only_chosen_points_get_a_row() -> None:
    points = sort_points(PointCloud(CLOUDS["volume"], np.zeros(3)))
    wanted = NEIGHBOURS_RNG.uniform(size=len(points.xyz)) < 0.1
    found = neighbours_of(points.xyz, points.code, points.frame, wanted, 16)
    np.testing.assert_array_equal(found, nearest(points.xyz, 16)[wanted])


NORMALS_RNG = np.random.default_rng(6)


def normals(xyz: np.ndarray, neighbours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    normal, spread = np.empty((len(xyz), 3), np.float32), np.empty((len(xyz), 3), np.float32)
    estimate_normals(xyz, np.arange(len(xyz)), neighbours.astype(np.int32), normal, spread)
    return normal, spread


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_normals_are_those_of_an_eigen_decomposition(scale: float) -> None:
    xyz = scale * (NORMALS_RNG.normal(0, 1, (300, 3)) * (3.0, 1.0, 0.2) + 50.0)
    found = nearest(xyz, 16)
    normal, spread = normals(xyz, found)
    for i in range(len(xyz)):
        expected, variances = plane_of(xyz[[i, *found[i]]])
        assert abs(normal[i] @ expected) == pytest.approx(1.0, abs=1e-5)
        np.testing.assert_allclose(spread[i], variances, rtol=1e-4, atol=1e-6 * scale**2)


def test_a_plane_without_noise_is_found_exactly() -> None:
    xyz = wall(NORMALS_RNG, noise=0.0, degrees=30.0)[:400]
    normal, spread = normals(xyz, nearest(xyz, 16))
    np.testing.assert_allclose(np.abs(normal @ [-0.5, np.sqrt(0.75), 0.0]), 1.0, atol=1e-6)
    assert spread[:, 0].max() < 1e-12


def test_a_point_with_one_neighbour_has_no_normal() -> None:
    normal, spread = normals(np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[1, -1, -1], [0, -1, -1]]))
    assert np.isnan(normal).all()
    assert np.isnan(spread).all()


@pytest.mark.parametrize("offset", [0.15, 0.3])
def test_robust_normals_between_two_copies_of_a_wall(offset: float) -> None:
    xyz = np.vstack([wall(NORMALS_RNG, 5, 4), wall(NORMALS_RNG, 5, 4, offset=offset)])
    found = nearest(xyz, 16).astype(np.int32)
    normal, spread = normals(xyz, found)
    plain = np.abs(normal[:, 1]) > np.cos(np.radians(15))
    variance = spread[:, 0].copy()
    robust_normals(xyz, np.arange(len(xyz)), np.ones(len(xyz), bool), found, 28, 28, 0.05, 0.3, normal, variance)
    robust = np.abs(normal[:, 1]) > np.cos(np.radians(15))
    assert robust.mean() > max(0.6, 1.1 * plain.mean())


@pytest.mark.parametrize(
    ("parts", "noise"),
    [
        ([wall(NORMALS_RNG)], 0.02),
        ([wall(NORMALS_RNG), wall(NORMALS_RNG, offset=0.15)], 0.02),
        ([wall(NORMALS_RNG, noise=0.03), wall(NORMALS_RNG, noise=0.03, offset=0.2)], 0.03),
        ([wall(NORMALS_RNG, noise=0.0), wall(NORMALS_RNG, noise=0.0, offset=0.15)], 0.0),
    ],
)
def test_noise_is_that_of_one_copy(parts: list[np.ndarray], noise: float) -> None:
    xyz = np.concatenate(parts)[NORMALS_RNG.permutation(sum(map(len, parts)))]
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


# Quantiles against numpy's.


VALUES = st.lists(st.floats(-1e6, 1e6), max_size=40) | st.lists(st.sampled_from([0.0, 1.0, 2.0]), max_size=40)


@given(st.lists(VALUES, min_size=1, max_size=4), st.floats(0, 1))
def test_quantiles_of_groups(groups, share):
    values = np.concatenate([np.array(group, np.float64) for group in groups])
    start = np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(np.int64)
    before = values.copy()
    expected = [np.quantile(group, share) if group else 0.0 for group in groups]
    assert quantiles(values, start, share) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    np.testing.assert_array_equal(values, before)
