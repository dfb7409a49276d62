from __future__ import annotations

import numpy as np

from mapq.kernels.cells import LEVELS, find_bounds, first_levels, number_cells, pick_one_a_cell

RNG = np.random.default_rng(7)


def slow_number(cell: np.ndarray) -> int:
    """Interleave the bits of a cell's three indices, x above y above z."""
    return sum(((int(cell[axis]) >> bit) & 1) << (3 * bit + 2 - axis) for bit in range(LEVELS) for axis in range(3))


def test_numbers_interleave_the_bits_of_the_indices() -> None:
    cells = RNG.integers(0, 1 << LEVELS, (200, 3))
    numbers = number_cells((cells + 0.5) / (1 << LEVELS), np.zeros(3), 1.0)
    assert numbers.tolist() == [slow_number(cell) for cell in cells]


def test_points_on_the_far_faces_belong_to_the_last_cells() -> None:
    assert number_cells(np.array([[1.0, 1.0, 1.0]]), np.zeros(3), 1.0).tolist() == [(1 << 3 * LEVELS) - 1]


def test_bounds() -> None:
    xyz = RNG.normal(0, 1, (50, 3))
    np.testing.assert_array_equal(find_bounds(xyz), [xyz.min(axis=0), xyz.max(axis=0)])


def test_first_levels_count_the_cells_of_every_level() -> None:
    code = np.sort(number_cells(RNG.uniform(0, 1, (3000, 3)), np.zeros(3), 1.0))
    first = first_levels(np.repeat(code, 2))
    for level in range(LEVELS + 1):
        n_cells = len(np.unique(code >> np.uint64(3 * (LEVELS - level))))
        assert np.count_nonzero(first <= level) == n_cells
    assert np.count_nonzero(first > LEVELS) == len(code)


def test_one_point_a_cell_and_not_always_the_first() -> None:
    code = np.sort(number_cells(RNG.uniform(0, 1, (3000, 3)), np.zeros(3), 1.0))
    picked = pick_one_a_cell(code, first_levels(code), 3)
    cells = code >> np.uint64(3 * (LEVELS - 3))
    np.testing.assert_array_equal(cells[picked], np.unique(cells))
    rank = picked - np.searchsorted(cells, cells[picked])
    assert 0 < np.mean(rank == 0) < 0.5
