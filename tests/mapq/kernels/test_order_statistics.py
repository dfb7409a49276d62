"""Quantiles against numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.kernels.order_statistics import quantiles

VALUES = st.lists(st.floats(-1e6, 1e6), max_size=40) | st.lists(st.sampled_from([0.0, 1.0, 2.0]), max_size=40)


@given(st.lists(VALUES, min_size=1, max_size=4), st.floats(0, 1))
def test_quantiles_of_groups(groups, share):
    values = np.concatenate([np.array(group, np.float64) for group in groups])
    start = np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(np.int64)
    before = values.copy()
    expected = [np.quantile(group, share) if group else 0.0 for group in groups]
    assert quantiles(values, start, share) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    np.testing.assert_array_equal(values, before)


def test_many_equal_values():
    values, start = np.repeat([3.0, 1.0, 2.0], 10_000), np.array([0, 30_000])
    assert quantiles(values, start, 0.1).tolist() == [1.0]
    assert quantiles(values, start, 0.9).tolist() == [3.0]
