"""Segments by cell, and the first of them on rays, against asking every segment."""

from __future__ import annotations

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.cell_lists import first_segments, list_segments
from prf.kernels.state.grid import Grid, make_grid, most_cells
from tests.kernels.entries import hit_table, walk_segments

GRID = make_grid(0.0, 0.0, 10.0, 8.0, 0.7)


def random_segments(rng: np.random.Generator, n: int) -> np.ndarray:
    start = rng.uniform((0.5, 0.5), (9.5, 7.5), (n, 2))
    return np.hstack([start, np.clip(start + rng.normal(0.0, 1.0, (n, 2)), 0.1, 7.9)])


def cells_passed(grid: Grid, segments: np.ndarray) -> list[set[int]]:
    cells, n_cells = np.zeros((len(segments), most_cells(grid)), np.int32), np.zeros(len(segments), np.int64)
    walk_segments(grid, segments, cells, n_cells)
    return [set(row[:n].tolist()) for row, n in zip(cells, n_cells, strict=True)]


@pytest.mark.parametrize("n", [0, 1, 200])
def test_each_cell_lists_the_segments_that_pass_it(n: int) -> None:
    segments = random_segments(np.random.default_rng(n), n)
    lists, passed = list_segments(GRID, segments), cells_passed(GRID, segments)
    for cell in range(GRID.nx * GRID.ny):
        listed = lists.listed[lists.start[cell] : lists.start[cell + 1]].tolist()
        assert listed == [k for k in range(n) if cell in passed[k]]


def test_the_first_segment_on_a_ray_is_the_nearest_outside_its_tile() -> None:
    rng = np.random.default_rng(5)
    segments, n = random_segments(rng, 80), 300
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    ray = np.column_stack([rng.uniform((1, 1), (9, 7), (n, 2)), np.cos(angle), np.sin(angle)])
    tile, owner = rng.integers(-1, 3, 80).astype(np.int32), rng.integers(-1, 3, n).astype(np.int32)
    limit, path = rng.uniform(0.1, 6.0, n), np.empty(most_cells(GRID), np.int32)
    found, distance = np.empty(n, np.int32), np.empty(n)
    first_segments(list_segments(GRID, segments), tile, ray, owner, limit, path, found, distance)
    table = np.empty((n, 80))
    hit_table(ray, segments, table)
    table[(owner[:, None] == tile) & (owner[:, None] != c.NONE)] = np.inf
    nearest = table.min(axis=1)
    is_hit = nearest < limit
    assert is_hit.sum() > 50
    np.testing.assert_array_equal(found, np.where(is_hit, table.argmin(axis=1), c.NONE))
    np.testing.assert_array_equal(distance, np.where(is_hit, nearest, limit))
