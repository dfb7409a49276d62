"""Points sorted in their planes: their gaps against brute force, and the memory that their cells take."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.features import measure_shapes
from mapq.features.shape import PatchShapes
from tests.mapq.factories import make_patches
from tests.reference.mapq_features import point_gaps

UPRIGHT = [0.0, 1.0, 0.0]


def shapes_of(*places: np.ndarray) -> PatchShapes:
    """Return patches of places (n, 2) in upright planes."""
    points = [np.column_stack([p[:, 0], np.zeros(len(p)), p[:, 1]]) for p in places]
    return measure_shapes(make_patches(points, [UPRIGHT] * len(places)))


def scan_lines(gap: float) -> np.ndarray:
    lines = np.array([(x, z) for z in np.arange(0, 3, gap) for x in np.arange(0, 6, 0.02)])
    return lines + np.random.default_rng(0).normal(0, 1e-4, lines.shape)


def places_of(shapes: PatchShapes, i: int) -> np.ndarray:
    sheets, some = shapes.sheets, slice(shapes.start[i], shapes.start[i + 1])
    return np.column_stack([sheets.u[some], sheets.v[some]])


@given(st.integers(0, 10**6), st.sampled_from([1, 2, 5, 40, 300]), st.floats(0.3, 4.0), st.booleans())
def test_gaps_are_those_of_brute_force(seed, n, power, twice):
    rng = np.random.default_rng(seed)
    places = rng.random((n, 2)) ** power * rng.uniform(0.01, 8, 2)
    shapes = shapes_of(np.vstack([places, places]) if twice else places, rng.random((9, 2)))
    for i in (0, 1):
        gap = shapes.sheets.gap[shapes.start[i] : shapes.start[i + 1]]
        np.testing.assert_allclose(gap, point_gaps(places_of(shapes, i), shapes.cell[i]), rtol=1e-7)
        assert (gap > 0).all()


def test_points_are_sorted_patch_after_patch_and_none_is_lost():
    rng = np.random.default_rng(4)
    shapes = shapes_of(rng.random((50, 2)), np.full((1, 2), np.nan), rng.random((70, 2)) * 9)
    sheets = shapes.sheets
    assert sorted(sheets.number[:50]) == list(range(50))
    assert shapes.counts.tolist() == [50, 0, 70]
    assert sorted(sheets.number[50:]) == list(range(50, 120))
    relative = shapes.points[sheets.number] - np.repeat(shapes.centre, shapes.counts, axis=0)
    np.testing.assert_array_equal(sheets.u, (relative * np.repeat(shapes.across, shapes.counts, axis=0)).sum(axis=1))
    assert sheets.first[-1] == 120


@pytest.mark.parametrize("side", [1e-3, 1.0, 1e7])
@pytest.mark.parametrize(
    "shape", [[[0, 0], [1, 0], [0, 1]], [[0, 0], [1, 1], [0.5, 0.501]], [[0, 0], [1, 0], [0.3, 1e-4]], [[0, 0]] * 3]
)
def test_few_points_make_few_cells_however_far_apart(shape, side):
    shapes = shapes_of(np.array(shape) * side, np.array(shape) * [1e-9, side])
    assert len(shapes.sheets.first) < 100
    assert np.isfinite(shapes.sheets.gap).all()
