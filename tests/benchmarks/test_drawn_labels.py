from __future__ import annotations

import numpy as np

from benchmarks.drawn_labels import draw_labels
from mapq.labels import UNLABELLED
from tests.mapq.labelled import draw_patches


def test_a_limited_number_of_patches_is_drawn_in_places():
    maps = [draw_patches(1), draw_patches(2)]
    labels = draw_labels(maps, 20, seed=3)
    assert sum(int((label != UNLABELLED).sum()) for label in labels) == 20
    for patches, label in zip(maps, labels, strict=True):
        known = label != UNLABELLED
        np.testing.assert_array_equal(label[known], patches.label[known])
    assert any(len(a) and (a != b).any() for a, b in zip(labels, draw_labels(maps, 20, seed=4), strict=True))
    np.testing.assert_array_equal(labels[0], draw_labels(maps, 20, seed=3)[0])
    everything = draw_labels(maps, 1000, seed=1)
    np.testing.assert_array_equal(everything[1], maps[1].label)
