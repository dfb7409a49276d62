"""The standardisation of features by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.train import fit_range, fit_scaling
from mapq.model import CLIP


def test_the_scale_is_the_interquartile_range():
    found = fit_scaling(np.arange(9.0)[:, None] * [1.0, 10.0], ("a", "b"))
    np.testing.assert_allclose(found.median, [4.0, 40.0])
    np.testing.assert_allclose(found.scale, [4.0, 40.0])
    assert (found.names, found.clip) == (("a", "b"), CLIP)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_clip_spares_all_but_one_value_in_a_hundred_on_either_side(sign):
    values = np.zeros(201)
    values[-40:] = np.linspace(1.0, 40.0, 40)
    found = fit_scaling(sign * values[:, None], ("x",))
    assert found.median == 0.0
    np.testing.assert_allclose(found.scale, 38.0 / CLIP)


@pytest.mark.parametrize("noise", [0.0, 1e-12])
@pytest.mark.parametrize("value", [3.0, -3.0])
def test_a_column_that_is_constant_but_for_rounding_has_scale_one(value, noise):
    found = fit_scaling(value + noise * np.arange(5.0)[:, None], ("x",))
    assert found.scale == 1.0


def test_a_column_that_varies_a_little_more_than_rounding_is_scaled():
    assert fit_scaling(3e-6 + 2e-12 * np.arange(5.0)[:, None], ("x",)).scale == pytest.approx(4e-12, rel=1e-3)
    assert fit_scaling(3.0 + 2e-9 * np.arange(5.0)[:, None], ("x",)).scale == pytest.approx(4e-9, rel=1e-6)


def test_without_rows_nothing_is_changed_and_one_row_is_its_own_median():
    empty = fit_scaling(np.zeros((0, 2)), ("a", "b"))
    np.testing.assert_array_equal(empty.apply(np.array([[3.0, -2.0]])), [[3.0, -2.0]])
    one = fit_scaling(np.array([[7.0]]), ("a",))
    assert (one.median, one.scale) == (7.0, 1.0)


def test_the_range_ends_where_values_do_or_at_the_clip():
    assert fit_range(np.zeros(0)) == (0.0, 0.0)
    assert fit_range(np.arange(9.0)) == (0.0, 8.0)
    wild = np.concatenate([np.linspace(-2.0, 2.0, 999), [1e6, -1e6]])
    low, high = fit_range(wild)
    assert high == -low == pytest.approx(CLIP * 2.0, rel=0.01)
    np.testing.assert_allclose(fit_range(wild + 7.0), (low + 7.0, high + 7.0), rtol=1e-12)
