from __future__ import annotations

import numpy as np

from mapq.report.page import N_BINS, histogram, histogram_svg


def test_areas_by_probability_and_label():
    p = np.array([0.0, 0.04, 0.96, 1.0, np.nan])
    sums, unit = histogram(p, np.array([0, 1, 1, 1, 0], np.uint8), np.array([1.0, 2.0, 4.0, 8.0, 16.0]))
    assert unit == "m²"
    assert (sums[0, 0], sums[1, 0], sums[1, N_BINS - 1]) == (1.0, 2.0, 12.0)
    assert sums.sum() == 15.0


def test_patches_are_counted_where_areas_are_not_known():
    sums, unit = histogram(np.array([0.5, 0.5]), np.array([0, 1], np.uint8), np.array([1.0, np.nan]))
    assert (unit, sums.sum()) == ("patches", 2.0)


def test_bars_show_their_area():
    sums = np.zeros((2, N_BINS))
    sums[0, 0], sums[1, 19] = 10.0, 5.0
    drawing = histogram_svg(sums, "m²", 0.5)
    assert drawing.count("<rect") == 2 * N_BINS
    assert 'height="124.0"' in drawing
    assert 'height="62.0"' in drawing
    assert "10 m² plausible, 5 m² suspicious" in drawing
