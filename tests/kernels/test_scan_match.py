"""Correlation of scans with places."""

from __future__ import annotations

import numpy as np

from prf.kernels.poses.scan_match import correlate


def test_totals_are_those_of_each_shift():
    rng = np.random.default_rng(1)
    field = rng.random((7, 9)).astype(np.float32)
    column, row = rng.integers(-6, 12, (2, 3, 5))
    total = np.zeros((3, 4, 6), np.float32)
    correlate(field, column, row, total)
    padded = np.pad(field, 20)
    for turn, y, x in np.ndindex(total.shape):
        expected = padded[20 + row[turn] + y, 20 + column[turn] + x].sum()
        np.testing.assert_allclose(total[turn, y, x], expected, rtol=1e-5)
