"""`patch_features` as a whole: what changes nothing, and what must not break it."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import FeatureSettings, patch_features
from mapq.features.shape import SHAPE_NAMES
from mapq.patches import Patches
from prf.shell.errors import ConfigError, InputError
from tests.mapq.factories import Rectangle, always_known, make_patches, moved, sample_patches, shuffled, turn, wall

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
    @pytest.mark.parametrize("reading", ["safe", "literal"])
    def test_the_order_of_the_points_to_the_last_bit(self, street, reading):
        settings = FeatureSettings(reading=reading)
        same(patch_features(street, settings), patch_features(shuffled(street, 7), settings))

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
    @pytest.mark.parametrize("reading", ["safe", "literal"])
    @pytest.mark.parametrize("name", POINTS)
    @pytest.mark.parametrize("apart", [[0, 0, 0], [0, 0.3, 0], [0, 100.0, 0]])
    def test_all_is_finite(self, name, apart, reading):
        points = POINTS[name]
        patches = make_patches([points, points + apart], [Y, Y], loose=3)
        features = patch_features(patches, FeatureSettings(reading=reading))
        assert len(features.pairs) == (apart[1] < 3)
        for values in (always_known(features), features.edge, features.plausibility, features.shape):
            assert np.isfinite(values).all()

    @pytest.mark.parametrize("reading", ["safe", "literal"])
    def test_no_patches(self, reading):
        features = patch_features(make_patches([], [], loose=5), FeatureSettings(reading=reading))
        assert features.node.shape == (0, len(features.node_names))
        assert features.edge.shape == (0, len(features.edge_names))
        assert (len(features.pairs), len(features.plausibility), features.n_clipped) == (0, 0, 0)
        assert features.shape.shape == (0, len(SHAPE_NAMES))


class TestSettings:
    @pytest.mark.parametrize(
        "bad",
        [
            {"reading": "paper"},
            {"n_neighbours": 0},
            {"n_neighbours": 10**20},
            {"n_watched": 10**20},
            {"radius": 0.0},
            {"radius": 1e300},
            {"tau": -1.0},
            {"eps": float("nan")},
            {"noise": float("inf")},
            {"tolerance": 0.0},
            {"n_watched": -1},
            {"up": (0.0, 0.0, 0.0)},
        ],
    )
    def test_refuses(self, bad):
        with pytest.raises(ConfigError):
            FeatureSettings(**bad)

    @pytest.mark.parametrize("up", [[0, 0, 0], [1, 2], "z"])
    def test_an_up_of_the_patches_that_is_none(self, up):
        patches = make_patches([np.zeros((3, 3))], [Y])
        patches.parameters["up"] = up  # type: ignore[index] # a dict of our own making
        with pytest.raises(InputError, match="no direction"):
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
