"""The neighbourhood against all pairs of all points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.features import FeatureSettings, measure_shapes, patch_features
from mapq.features.pairs import find_neighbours
from mapq.patches import Patches
from tests.mapq.factories import make_patches, sample_patches, wall
from tests.reference.mapq_features import neighbours


def draw_clusters(seed: int, n_patches: int, whole: bool) -> list[np.ndarray]:
    """Return small clouds of 1 to 60 points; on whole metres many distances are equal."""
    rng = np.random.default_rng(seed)
    clusters = []
    for _ in range(n_patches):
        points = rng.uniform(-6, 6, 3) + rng.normal(size=(rng.integers(1, 60), 3)) * rng.uniform(0.05, 2, 3)
        clusters.append(np.round(points) if whole else points)
    return clusters


def graph_of(points: list[np.ndarray], settings: FeatureSettings):
    return find_neighbours(measure_shapes(make_patches(points, [[0.0, 1.0, 0.0]] * len(points))), settings)


@given(
    st.integers(0, 10**6), st.integers(1, 9), st.booleans(), st.integers(1, 5), st.sampled_from([0.3, 1.0, 2.0, 9.0])
)
def test_neighbours_are_those_of_brute_force(seed, n_patches, whole, n_neighbours, radius):
    points = draw_clusters(seed, n_patches, whole)
    for n_watched in (0, 3, 8):
        settings = FeatureSettings(n_neighbours=n_neighbours, radius=radius, n_watched=n_watched)
        graph = graph_of(points, settings)
        expected = neighbours(points, max(n_neighbours, n_watched), radius)
        assert list(map(tuple, graph.pairs.tolist())) == sorted(expected)
        assert graph.separation == pytest.approx([expected[pair] for pair in sorted(expected)], rel=1e-12, abs=1e-15)
        close = map(tuple, graph.pairs[graph.close].tolist())
        assert list(close) == sorted(neighbours(points, n_neighbours, radius))


@pytest.fixture(scope="module")
def street() -> Patches:
    panes = [wall((x, 0.02), (x + 0.4, 0.02), height=0.5, foot=1) for x in np.arange(-4, 4, 0.9)]
    walls = [wall((-5, 0), (5, 0)), wall((-5, 0.5), (5, 0.5)), wall((2, -4), (2, 4)), wall((-5, 6), (5, 6))]
    return sample_patches([*walls, *panes], density=10)


class TestConflicts:
    """A doubled wall among many small patches: its copy is not one of the closest."""

    def test_those_watched_that_lie_over_or_cross_are_joined_too(self, street):
        points = [street.cloud.xyz[street.patch == k] for k in range(len(street))]
        every = patch_features(street, FeatureSettings(n_neighbours=len(street), n_watched=0))
        conflict = every.edge[:, [every.edge_names.index(name) for name in ("overlap", "crossing")]].sum(axis=1) > 0.05
        for n_neighbours, n_watched in ((1, 0), (1, 5), (2, 16), (4, 2)):
            closest = set(neighbours(points, n_neighbours, 3.0))
            watched = set(neighbours(points, max(n_neighbours, n_watched), 3.0))
            expected = closest | {tuple(p) for p in every.pairs[conflict].tolist() if tuple(p) in watched}
            found = patch_features(street, FeatureSettings(n_neighbours=n_neighbours, n_watched=n_watched))
            assert list(map(tuple, found.pairs.tolist())) == sorted(expected)
            rows = [every.pairs.tolist().index(pair) for pair in found.pairs.tolist()]
            np.testing.assert_array_equal(found.edge, every.edge[rows])
            np.testing.assert_array_equal(found.plausibility, every.plausibility[rows])

    def test_the_copy_of_a_wall_is_found_that_way(self, street):
        plain, watched = (patch_features(street, FeatureSettings(n_neighbours=1, n_watched=n)) for n in (0, 16))
        assert [0, 1] not in plain.pairs.tolist()
        assert [0, 1] in watched.pairs.tolist()

    def test_the_literal_reading_has_the_closest_only(self, street):
        settings = FeatureSettings("literal", n_neighbours=1)
        points = [street.cloud.xyz[street.patch == k] for k in range(len(street))]
        assert list(map(tuple, patch_features(street, settings).pairs.tolist())) == sorted(neighbours(points, 1, 3.0))


def test_pairs_looked_at_bit_by_bit_are_the_same(monkeypatch):
    points = draw_clusters(11, 30, False)
    settings = FeatureSettings(n_neighbours=3, n_watched=5)
    whole = graph_of(points, settings)
    monkeypatch.setattr("mapq.features.pairs.MOST_PAIRS", 5)
    for one, other in zip(whole, graph_of(points, settings), strict=True):
        np.testing.assert_array_equal(one, other)


def test_equally_close_ones_follow_from_their_size_and_place_and_not_from_their_numbers():
    shape = np.array([[0.0, 0, 0], [0, 0, 1], [0, 0, 2]])
    around = [shape + np.array(to) for to in ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    large = np.vstack([shape, shape + np.array([0, 0, 0.5])]) + np.array([0.6, 0.8, 0])
    points = [*around, large]
    for order in (range(6), [3, 1, 5, 0, 2, 4]):
        graph = graph_of([points[k] for k in order], FeatureSettings(n_neighbours=2, radius=1.0, n_watched=0))
        named = {tuple(sorted((order[i], order[j]))) for i, j in graph.pairs.tolist()}
        assert {(0, 5), (0, 2)} <= named, "the largest, then the one with the smallest x"
        assert (0, 4) in named, "one that has no other"
