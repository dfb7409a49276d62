"""Quantiles against numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.kernels.order_statistics import spans

VALUES = st.lists(st.floats(-1e6, 1e6), max_size=40) | st.lists(st.sampled_from([0.0, 1.0, 2.0]), max_size=40)


@given(st.lists(VALUES, min_size=1, max_size=4), st.floats(0, 1), st.floats(0, 1))
def test_span_is_the_distance_of_two_quantiles(groups, low, high):
    values = np.concatenate([np.array(group, np.float64) for group in groups])
    start = np.concatenate([[0], np.cumsum([len(group) for group in groups])]).astype(np.int64)
    before = values.copy()
    expected = [np.quantile(group, high) - np.quantile(group, low) if group else 0.0 for group in groups]
    assert spans(values, start, low, high) == pytest.approx(expected, rel=1e-9, abs=1e-6)
    np.testing.assert_array_equal(values, before)


def test_many_equal_values():
    values = np.repeat([3.0, 1.0, 2.0], 10_000)
    assert spans(values, np.array([0, len(values)]), 0.1, 0.9).tolist() == [2.0]
