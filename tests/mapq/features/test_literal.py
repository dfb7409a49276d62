"""The equations as printed, against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.features import FeatureSettings, patch_features
from mapq.features.literal import BOUND
from tests.mapq.factories import Rectangle, make_patches, sample_patches, wall
from tests.reference.mapq_features import literal_edge, literal_node

PAIRS = {
    "leaning walls": [Rectangle((0, 0, 2), (1, 0, 0), (0, 0.2, 1)), Rectangle((0, 0.4, 2), (1, 0.1, 0), (0, -0.1, 1))],
    "crossing": [wall((-5, 0), (5, 0)), Rectangle((1, 0, 2), (0.1, 1, 0), (0.1, 0, 1), 6, 4)],
    "far outside one another": [wall((-5, 0), (5, 0)), wall((-3, 2), (4, 3))],
}


@pytest.mark.parametrize("name", PAIRS)
def test_is_what_the_equations_say(name):
    patches = sample_patches(PAIRS[name], density=10)
    points = [patches.cloud.xyz[patches.patch == k] for k in (0, 1)]
    features = patch_features(patches, FeatureSettings(reading="literal", tau=0.7))
    assert features.reading == "literal"
    for k in (0, 1):
        expected = np.clip(literal_node(points[k], patches.normal[k]), -BOUND, BOUND)
        assert features.node[k] == pytest.approx(expected, rel=1e-8)
    *edge, x = literal_edge(*points, (patches.normal[0], patches.normal[1]), 0.7)
    assert features.edge[0, :4] == pytest.approx(edge, rel=1e-8)
    assert features.plausibility[0] == pytest.approx(x, rel=1e-8)


def test_upright_walls_break_equation_7_and_11():
    features = patch_features(
        sample_patches([wall((-5, 0), (5, 0)), wall((-5, 0.3), (5, 0.3))]), FeatureSettings("literal")
    )
    assert np.abs(features.node[:, 1]).tolist() == [BOUND, BOUND]
    assert features.n_clipped == 2
    assert features.plausibility[0] < -10


def test_flat_patches_are_cut_and_counted():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    features = patch_features(make_patches([square], [[0.0, 1.0, 0.0]]), FeatureSettings(reading="literal"))
    assert features.node[0].tolist() == [BOUND, BOUND, 0.0]
    assert features.n_clipped == 3
