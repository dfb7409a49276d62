from __future__ import annotations

import numpy as np
import pytest

from mapq.report.thin import evenly


def test_few_points_all_stay():
    xyz = np.random.default_rng(0).uniform(size=(50, 3))
    np.testing.assert_array_equal(evenly(xyz, np.zeros(50, np.int32), 50), np.arange(50))


@pytest.mark.parametrize("n_most", [100, 1_000, 5_000])
def test_of_many_nearly_as_many_stay_as_may(n_most):
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(0, 40, 20_000), rng.uniform(0, 30, 20_000), rng.normal(0, 0.02, 20_000)])
    chosen = evenly(xyz, np.zeros(20_000, np.int32), n_most)
    assert 0.6 * n_most <= len(chosen) <= n_most
    assert (np.diff(chosen) > 0).all()


def test_what_is_sparse_keeps_its_points_beside_what_is_dense():
    rng = np.random.default_rng(2)
    dense, sparse = rng.uniform(0, 10, (50_000, 2)), rng.uniform(0, 10, (8_000, 2)) + 20.0
    xyz = np.column_stack([np.concatenate([dense, sparse]), np.zeros(58_000)])
    chosen = evenly(xyz, np.zeros(58_000, np.int32), 2_000)
    assert 0.8 < np.count_nonzero(chosen >= 50_000) / np.count_nonzero(chosen < 50_000) < 1.2


def test_every_group_stays():
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(300, dtype=np.int32), 40)
    chosen = evenly(rng.uniform(0, 0.1, (12_000, 3)), group, 400)
    assert len(np.unique(group[chosen])) == 300


def test_points_in_one_place():
    assert 1 <= len(evenly(np.zeros((1_000, 3)), np.zeros(1_000, np.int32), 100)) <= 100
