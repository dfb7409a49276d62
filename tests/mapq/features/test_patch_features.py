"""`patch_features` as a whole: what changes nothing, and what must not break it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.cloud import PointCloud
from mapq.configuration import FeatureSettings
from mapq.features import measure_shapes, patch_features
from mapq.features.pairs import find_neighbours
from mapq.features.shape import SHAPE_NAMES
from mapq.patches import Patches
from prf.shell.errors import ArgumentError, InputError
from tests.mapq.factories import Rectangle, always_known, make_patches, moved, sample_patches, shuffled, turn, wall
from tests.reference.mapq_features import neighbours

STREET = [
    Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 20, 20),
    wall((-8, -3), (8, -3)),
    wall((-8, -2.6), (8, -3.2)),
    wall((-8, 3), (0, 3)),
    wall((0, 3), (0, 9)),
    wall((1.2, 3), (6, 3)),
    Rectangle((3, -1, 0.8), (0.9, 0.2, 0), (0.1, 0.1, 1), 2, 1.5),
]
Y = [0.0, 1.0, 0.0]
POINTS = {
    "one point": np.zeros((1, 3)),
    "duplicates": np.zeros((9, 3)),
    "three points": np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]),
    "an upright line": np.linspace(0, 5, 40)[:, None] * [0, 0, 1.0],
    "a line": np.linspace(0, 5, 40)[:, None] * [1.0, 0, 0],
    "an exact plane": np.array([(x, 0.0, z) for x in np.arange(0, 3, 0.1) for z in np.arange(0, 2, 0.1)]),
}


@pytest.fixture(scope="module")
def street() -> Patches:
    return sample_patches(STREET, density=15)


def same(one, two, tolerance=0.0):
    assert one.pairs.tolist() == two.pairs.tolist()
    for name in ("node", "edge", "plausibility", "shape"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=tolerance, atol=tolerance)


class TestNothingDependsOn:
    def test_the_order_of_the_points_to_the_last_bit(self, street):
        same(patch_features(street), patch_features(shuffled(street, 7)))

    def test_points_without_a_patch(self, street):
        points = [street.cloud.xyz[street.patch == k] for k in range(len(street))]
        same(patch_features(street), patch_features(make_patches(points, street.normal, loose=500)))

    @pytest.mark.parametrize("to", [(1000.0, -2000.0, 30.0), (5e5, 5.4e6, 300.0)])
    def test_a_shift(self, street, to):
        there = street.cloud.world() + np.array(to)
        cloud = PointCloud.from_world(there)
        shifted = Patches.unlabelled(
            cloud, street.patch, street.normal, street.centroid + np.array(to) - cloud.shift, {}, {}
        )
        same(patch_features(street), patch_features(shifted), 1e-5)

    @pytest.mark.parametrize("degrees", [90, 180, 270])
    def test_a_quarter_turn(self, street, degrees):
        same(patch_features(street), patch_features(moved(street, turn(degrees))), 1e-8)

    def test_any_turn_but_for_cells_of_level_patches(self, street):
        one, two = patch_features(street), patch_features(moved(street, turn(37)))
        assert one.plausibility == pytest.approx(two.plausibility, abs=0.02)

    def test_the_sign_of_normals(self, street):
        flipped = moved(street, np.eye(3))
        flipped.normal[::2] *= -1
        same(patch_features(street), patch_features(flipped), 1e-9)

    def test_the_numbers_of_the_patches(self, street):
        order = np.random.default_rng(1).permutation(len(street))
        points = [street.cloud.xyz[street.patch == k] for k in order]
        one, two = patch_features(street), patch_features(make_patches(points, street.normal[order]))
        np.testing.assert_array_equal(one.node[order], two.node)
        x = {(i, j): x for (i, j), x in zip(one.pairs.tolist(), one.plausibility.tolist(), strict=True)}
        y = {tuple(sorted((order[i], order[j]))): y for (i, j), y in zip(two.pairs, two.plausibility, strict=True)}
        assert x == pytest.approx(y, abs=1e-9)


class TestDegenerate:
    @pytest.mark.parametrize("name", POINTS)
    @pytest.mark.parametrize("apart", [[0, 0, 0], [0, 0.3, 0], [0, 100.0, 0]])
    def test_all_is_finite(self, name, apart):
        points = POINTS[name]
        patches = make_patches([points, points + apart], [Y, Y], loose=3)
        features = patch_features(patches)
        assert len(features.pairs) == (apart[1] < 3)
        for values in (always_known(features), features.edge, features.plausibility, features.shape):
            assert np.isfinite(values).all()

    def test_no_patches(self):
        features = patch_features(make_patches([], [], loose=5))
        assert features.node.shape == (0, len(features.node_names))
        assert features.edge.shape == (0, len(features.edge_names))
        assert (len(features.pairs), len(features.plausibility)) == (0, 0)
        assert features.shape.shape == (0, len(SHAPE_NAMES))


class TestSettings:
    @pytest.mark.parametrize(
        "bad",
        [
            {"neighbours": 0},
            {"neighbours": 10**20},
            {"watched": 10**20},
            {"radius": 0.0},
            {"radius": 1e300},
            {"tau": -1.0},
            {"eps": float("nan")},
            {"noise": float("inf")},
            {"tolerance": 0.0},
            {"watched": -1},
            {"up": (0.0, 0.0, 0.0)},
        ],
    )
    def test_refuses(self, bad):
        with pytest.raises(ArgumentError, match=f"^{next(iter(bad))}"):
            FeatureSettings(**bad)

    @pytest.mark.parametrize("up", [[0, 0, 0], [1, 2], "z"])
    def test_an_up_of_the_patches_that_is_none(self, up):
        patches = make_patches([np.zeros((3, 3))], [Y])
        patches.parameters["up"] = up  # type: ignore[index] # a dict of our own making
        with pytest.raises(InputError, match="must be three numbers, not all 0"):
            patch_features(patches)

    def test_used_features_are_returned(self, street):
        used = patch_features(street, FeatureSettings(radius=2.0)).parameters
        assert (used["radius"], used["tau"], used["n_neighbours"], used["n_watched"]) == (2.0, 2.0, 4, 16)
        assert used["noise"] == pytest.approx(0.02, rel=0.1)
        assert patch_features(street, FeatureSettings(noise=0.001)).parameters["noise"] == 0.01, "eps is the least"

    @pytest.mark.parametrize(("noise", "given", "used"), [(0.01, 0.05, 0.05), (0.04, 0.05, 0.132), (0.04, 0.3, 0.3)])
    def test_the_tolerance_is_never_below_what_noise_hides(self, street, noise, given, used):
        found = patch_features(street, FeatureSettings(noise=noise, tolerance=given)).parameters["tolerance"]
        assert found == pytest.approx(used)


# The neighbourhood against all pairs of all points.


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
        settings = FeatureSettings(neighbours=n_neighbours, radius=radius, watched=n_watched)
        graph = graph_of(points, settings)
        expected = neighbours(points, max(n_neighbours, n_watched), radius)
        assert list(map(tuple, graph.pairs.tolist())) == sorted(expected)
        assert graph.separation == pytest.approx([expected[pair] for pair in sorted(expected)], rel=1e-12, abs=1e-15)
        close = map(tuple, graph.pairs[graph.close].tolist())
        assert list(close) == sorted(neighbours(points, n_neighbours, radius))


@pytest.fixture(scope="module")
def pairs_street() -> Patches:
    panes = [wall((x, 0.02), (x + 0.4, 0.02), height=0.5, foot=1) for x in np.arange(-4, 4, 0.9)]
    walls = [wall((-5, 0), (5, 0)), wall((-5, 0.5), (5, 0.5)), wall((2, -4), (2, 4)), wall((-5, 6), (5, 6))]
    return sample_patches([*walls, *panes], density=10)


class TestConflicts:
    """A doubled wall among many small patches: its copy is not one of the closest."""

    def test_those_watched_that_lie_over_or_cross_are_joined_too(self, pairs_street):
        points = [pairs_street.cloud.xyz[pairs_street.patch == k] for k in range(len(pairs_street))]
        every = patch_features(pairs_street, FeatureSettings(neighbours=len(pairs_street), watched=0))
        conflict = every.edge[:, [every.edge_names.index(name) for name in ("overlap", "crossing")]].sum(axis=1) > 0.05
        for n_neighbours, n_watched in ((1, 0), (1, 5), (2, 16), (4, 2)):
            closest = set(neighbours(points, n_neighbours, 3.0))
            watched = set(neighbours(points, max(n_neighbours, n_watched), 3.0))
            expected = closest | {tuple(p) for p in every.pairs[conflict].tolist() if tuple(p) in watched}
            found = patch_features(pairs_street, FeatureSettings(neighbours=n_neighbours, watched=n_watched))
            assert list(map(tuple, found.pairs.tolist())) == sorted(expected)
            rows = [every.pairs.tolist().index(pair) for pair in found.pairs.tolist()]
            np.testing.assert_array_equal(found.edge, every.edge[rows])
            np.testing.assert_array_equal(found.plausibility, every.plausibility[rows])

    def test_the_copy_of_a_wall_is_found_that_way(self, pairs_street):
        plain, watched = (patch_features(pairs_street, FeatureSettings(neighbours=1, watched=n)) for n in (0, 16))
        assert [0, 1] not in plain.pairs.tolist()
        assert [0, 1] in watched.pairs.tolist()


def test_pairs_looked_at_bit_by_bit_are_the_same(monkeypatch):
    points = draw_clusters(11, 30, False)
    settings = FeatureSettings(neighbours=3, watched=5)
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
        graph = graph_of([points[k] for k in order], FeatureSettings(neighbours=2, radius=1.0, watched=0))
        named = {tuple(sorted((order[i], order[j]))) for i, j in graph.pairs.tolist()}
        assert {(0, 5), (0, 2)} <= named, "the largest, then the one with the smallest x"
        assert (0, 4) in named, "one that has no other"
