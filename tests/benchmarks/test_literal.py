"""The equations of the paper as they are printed: against brute force, and where they have no value."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.literal import BOUND, literal_features
from mapq.configuration import FeatureSettings
from mapq.features.pairs import EDGE_NAMES
from tests.mapq.factories import Rectangle, make_patches, sample_patches, shuffled, wall
from tests.reference.mapq_features import literal_edge, literal_node, neighbours

PAIRS = {
    "leaning walls": [Rectangle((0, 0, 2), (1, 0, 0), (0, 0.2, 1)), Rectangle((0, 0.4, 2), (1, 0.1, 0), (0, -0.1, 1))],
    "crossing": [wall((-5, 0), (5, 0)), Rectangle((1, 0, 2), (0.1, 1, 0), (0.1, 0, 1), 6, 4)],
    "far outside one another": [wall((-5, 0), (5, 0)), wall((-3, 2), (4, 3))],
}


@pytest.mark.parametrize("name", PAIRS)
def test_is_what_the_equations_say(name):
    patches = sample_patches(PAIRS[name], density=10)
    points = [patches.cloud.xyz[patches.patch == k] for k in (0, 1)]
    features = literal_features(patches, FeatureSettings(tau=0.7))
    for k in (0, 1):
        expected = np.clip(literal_node(points[k], patches.normal[k]), -BOUND, BOUND)
        assert features.node[k] == pytest.approx(expected, rel=1e-8)
    *edge, x = literal_edge(*points, (patches.normal[0], patches.normal[1]), 0.7)
    assert features.edge[0, :4] == pytest.approx(edge, rel=1e-8)
    assert features.plausibility[0] == pytest.approx(x, rel=1e-8)


def test_upright_walls_break_equation_7_and_11():
    features = literal_features(sample_patches([wall((-5, 0), (5, 0)), wall((-5, 0.3), (5, 0.3))]))
    assert np.abs(features.node[:, 1]).tolist() == [BOUND, BOUND]
    assert features.plausibility[0] < -10


def test_values_of_flat_patches_are_cut():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    features = literal_features(make_patches([square], [[0.0, 1.0, 0.0]]))
    assert features.node[0].tolist() == [BOUND, BOUND, 0.0]


POINTS = {
    "one point": np.zeros((1, 3)),
    "duplicates": np.zeros((9, 3)),
    "a line": np.linspace(0, 5, 40)[:, None] * [1.0, 0, 0],
    "an exact plane": np.array([(x, 0.0, z) for x in np.arange(0, 3, 0.1) for z in np.arange(0, 2, 0.1)]),
}


@pytest.mark.parametrize("name", POINTS)
@pytest.mark.parametrize("apart", [0.0, 0.3, 100.0])
def test_all_is_finite(name, apart):
    points = POINTS[name]
    features = literal_features(
        make_patches([points, points + np.array([0, apart, 0])], [[0.0, 1.0, 0.0]] * 2, loose=3)
    )
    assert len(features.pairs) == (apart < 3)
    for values in (features.node, features.edge, features.plausibility):
        assert np.isfinite(values).all()


def test_no_patches():
    features = literal_features(make_patches([], [], loose=5))
    assert features.node.shape == (0, len(features.node_names))
    assert features.edge.shape == (0, len(features.edge_names))
    assert (len(features.pairs), len(features.plausibility)) == (0, 0)


def test_pairs_are_those_of_the_closest_without_context_in_any_order_of_the_points():
    panes = [wall((x, 0.02), (x + 0.4, 0.02), height=0.5, foot=1) for x in np.arange(-4, 4, 0.9)]
    patches = sample_patches([wall((-5, 0), (5, 0)), wall((-5, 0.5), (5, 0.5)), *panes], density=10)
    points = [patches.cloud.xyz[patches.patch == k] for k in range(len(patches))]
    found, again = (literal_features(each, FeatureSettings(neighbours=1)) for each in (patches, shuffled(patches, 7)))
    assert list(map(tuple, found.pairs.tolist())) == sorted(neighbours(points, 1, 3.0))
    assert (found.edge_names, found.context_names) == (EDGE_NAMES, ())
    for name in ("node", "pairs", "edge", "plausibility"):
        np.testing.assert_array_equal(getattr(found, name), getattr(again, name))
