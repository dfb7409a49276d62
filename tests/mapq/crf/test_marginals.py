from __future__ import annotations

import numpy as np
import pytest

from mapq.crf.marginals import fit_temperature, log_loss, probabilities


def test_a_probability_is_on_the_side_of_its_label_even_where_it_ties():
    difference = np.array([0.0, 1e-12, -1e-12, 3.0, -3.0, 1e4, -1e4])
    label = np.array([1, 1, 0, 1, 0, 1, 0], np.uint8)
    p = probabilities(difference, label, 2.0)
    assert p.dtype == np.float32
    np.testing.assert_array_equal(p > 0.5, label == 1)
    np.testing.assert_array_equal(p < 0.5, label == 0)
    np.testing.assert_allclose(p[3:5], [1 / (1 + np.exp(-6)), 1 / (1 + np.exp(6))], rtol=1e-6)
    assert ((p >= 0.0) & (p <= 1.0)).all()


@pytest.mark.parametrize("temperature", [0.2, 1.0, 4.0])
def test_the_temperature_that_made_the_labels_is_found(temperature):
    rng = np.random.default_rng(0)
    difference = rng.normal(scale=2.0 / temperature, size=20000)
    y = np.where(rng.random(20000) < 1 / (1 + np.exp(-temperature * difference)), 1.0, -1.0)
    found = fit_temperature(difference, y)
    assert found == pytest.approx(temperature, rel=0.06)
    assert log_loss(difference, y, found) < log_loss(difference, y, 1.3 * found)


def test_patches_that_are_all_right_keep_some_doubt():
    y = np.array([1.0, -1.0] * 10)
    found = fit_temperature(3.0 * y, y)
    assert 1 / (1 + np.exp(-found * 3.0)) == pytest.approx(11 / 12, rel=1e-4)
