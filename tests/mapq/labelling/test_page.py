from __future__ import annotations

import numpy as np

from mapq.labelling.page import most_uncertain_first


def test_the_most_uncertain_first_of_equals_the_largest_and_labelled_ones_last():
    p = np.array([0.9, 0.55, 0.45, 0.5, 0.1])
    label = np.array([False, False, False, True, False])
    assert most_uncertain_first(np.array([9, 2, 4, 7, 30]), p, label).tolist() == [2, 1, 4, 0, 3]


def test_without_probabilities_the_largest_first():
    assert most_uncertain_first(np.array([3, 9, 5]), None, np.zeros(3, np.bool_)).tolist() == [1, 2, 0]


def test_a_probability_that_does_not_exist_is_as_uncertain_as_can_be():
    assert most_uncertain_first(np.array([3, 9]), np.array([np.nan, 0.4]), np.zeros(2, np.bool_)).tolist() == [0, 1]
