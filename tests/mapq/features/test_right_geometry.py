"""Right geometry that looks wrong, and its wrong counterparts: at three densities and two noises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from mapq.features import patch_features
from mapq.features.table import PatchFeatures
from mapq.patches import Patches
from tests.mapq.factories import Rectangle, make_patches, wall

POINTS = 100.0
"""A square metre, of the densest map."""
Hole = tuple[float, float, float, float]
Surface = tuple[Rectangle, Sequence[Hole]]
MAPS = [(1.0, 0.005), (1.0, 0.03), (1.0 / 3.0, 0.005), (1.0 / 3.0, 0.03), (0.1, 0.005), (0.1, 0.03)]
every_map = pytest.mark.parametrize(("density", "noise"), MAPS)


def sampled(surfaces: Sequence[Surface], density: float, noise: float, seed: int = 0) -> Patches:
    """Return the patches of rectangles with holes, given across and along from the middle: low, high, low, high."""
    points = []
    for k, (rectangle, holes) in enumerate(surfaces):
        found = rectangle.sample(np.random.default_rng((seed, k)), density * POINTS, noise)
        u, v = ((found - rectangle.middle) @ rectangle.axes[:2].T).T
        for a, b, c, d in holes:
            inside = (a < u) & (u < b) & (c < v) & (v < d)
            found, u, v = found[~inside], u[~inside], v[~inside]
        points.append(found)
    return make_patches(points, [rectangle.axes[2] for rectangle, _ in surfaces])


def plain(*rectangles: Rectangle) -> list[Surface]:
    return [(rectangle, ()) for rectangle in rectangles]


def worst(features: PatchFeatures, name: str) -> float:
    return float(features.edge[:, features.edge_names.index(name)].max(initial=0.0))


def turned(degrees: float) -> Rectangle:
    c, s = 7.0 * np.cos(np.radians(degrees)), 7.0 * np.sin(np.radians(degrees))
    return wall((-c, -s), (c, s), 5.0)


FRONT = wall((-8, 0), (8, 0), 5.0)
GATE: Surface = (FRONT, [(-2.0, 2.0, -2.5, 1.5)])
OPEN_GATE: Surface = (FRONT, [(-2.0, 2.0, -2.5, 2.5)])
JAMBS = plain(*(wall((x, -1.5), (x, 1.5), 4.0) for x in (-2.0, 2.0)))
RIGHT: dict[str, list[Surface]] = {
    "gate with jambs that reach to both sides": [GATE, *JAMBS],
    "gate without a lintel": [OPEN_GATE, *JAMBS],
    "road walls through a gate": [GATE, *plain(*(wall((x, -6), (x, 6), 2.0) for x in (-2.0, 2.0)))],
    "wall through the middle of a gate": [GATE, *plain(wall((0, -6), (0, 6), 2.5))],
    "T": plain(FRONT, wall((1, 0), (1, 7), 5.0)),
    "niche": [
        (FRONT, [(-2.0, 2.0, -2.5, 1.5)]),
        *plain(wall((-2, 1), (2, 1), 4.0), wall((-2, 0), (-2, 1), 4.0), wall((2, 0), (2, 1), 4.0)),
    ],
    "wall over a low one": plain(wall((-8, 0), (8, 0), 3.0), wall((0, -6), (0, 6), 3.0, foot=3.4)),
}
WRONG: dict[str, list[Surface]] = {
    **{f"copies that cross at {angle} degrees": plain(FRONT, turned(angle)) for angle in (2, 5, 10, 20)},
    "copy of a wall that ends at another": plain(FRONT, wall((1, -2.5), (1, 6), 5.0)),
    "copy of a wall with windows": [
        (FRONT, [(x - 0.6, x + 0.6, -0.8, 0.8) for x in (-6, -3, 0, 3, 6)]),
        *plain(wall((1.5, -4), (1.5, 5), 5.0)),
    ],
}


class TestCrossing:
    @every_map
    @pytest.mark.parametrize("name", RIGHT)
    def test_nothing_crosses_through_an_opening(self, name, density, noise):
        assert worst(patch_features(sampled(RIGHT[name], density, noise)), "crossing") < 0.03

    @every_map
    @pytest.mark.parametrize("name", WRONG)
    def test_what_passes_through_a_surface_does(self, name, density, noise):
        assert worst(patch_features(sampled(WRONG[name], density, noise)), "crossing") > 0.15


def seen_from(patches: Patches, sensors: Sequence[tuple[float, float, float]]) -> Patches:
    way = np.asarray(sensors, np.float64)[patches.patch] - patches.cloud.xyz
    fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
    return replace(patches, cloud=patches.cloud.with_fields(**fields))


def facing(patches: Patches) -> float:
    """Return how surely a pair faces away, in -1 to 1."""
    found = patch_features(patches)
    values = dict(zip(found.edge_names, found.edge[0], strict=True))
    return float(values["facing_away"] / (values["weight"] * values["overlap"]))


BEFORE, BEHIND, FAR = (1.0, -5.0, 1.5), (2.0, 5.0, 1.5), (1.0, -9.0, 1.5)


class TestFaces:
    @every_map
    @pytest.mark.parametrize("apart", [0.15, 0.3, 0.6])
    def test_faces_of_one_wall_are_distinguished_from_copies(self, apart, density, noise):
        pair = sampled(plain(FRONT, wall((-8, apart), (8, apart), 5.0)), density, noise)
        flipped = replace(pair, normal=pair.normal * [[1.0], [-1.0]])
        for patches in (pair, flipped):
            assert facing(seen_from(patches, [BEFORE, BEHIND])) == pytest.approx(1.0)
            assert facing(seen_from(patches, [BEFORE, FAR])) == pytest.approx(-1.0)
            assert facing(seen_from(patches, [BEHIND, BEFORE])) == pytest.approx(-1.0), "nobody stood between them"

    def test_what_is_seen_from_both_sides_is_no_evidence(self):
        pair = sampled(plain(FRONT, wall((-8, 0.3), (8, 0.3), 5.0)), 1.0, 0.005)
        way = np.where(np.arange(len(pair.patch))[:, None] % 2, BEFORE, BEHIND) - pair.cloud.xyz
        fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
        assert facing(replace(pair, cloud=pair.cloud.with_fields(**fields))) < 0.0


def outline(surfaces: Sequence[Surface], density: float, noise: float, name: str) -> float:
    """Return an outline column of the pair over what it explains, W A."""
    found = patch_features(sampled(surfaces, density, noise))
    values = dict(zip(found.edge_names, found.edge[0], strict=True))
    return float(values[name] / (values["weight"] * values["overlap"]))


class TestOutlines:
    @every_map
    @pytest.mark.parametrize("apart", [0.3, 0.45, 0.6])
    def test_galleries_and_hedges_cover_a_part_and_copies_all(self, apart, density, noise):
        low = plain(FRONT, wall((-8, apart), (8, apart), 1.2))
        copy = plain(FRONT, wall((-7.8, apart), (8.2, apart), 5.0))
        for name in ("partly_covered", "unlike_height"):
            assert outline(low, density, noise, name) > 0.6 > 0.35 > outline(copy, density, noise, name)

    @every_map
    @pytest.mark.parametrize("deep", [0.15, 0.4])
    def test_an_infill_does_not_lie_over_its_wall(self, deep, density, noise):
        features = patch_features(sampled([GATE, *plain(wall((-2, deep), (2, deep), 4.0))], density, noise))
        assert worst(features, "overlap") < 0.2


class TestArea:
    @every_map
    def test_is_that_of_the_surface(self, density, noise):
        features = patch_features(sampled([GATE, *JAMBS], density, noise))
        area = features.shape[:, features.shape_names.index("area_m2")]
        assert area == pytest.approx([64.0, 12.0, 12.0], rel=0.25)

    def test_few_points_far_off_support_little(self):
        """A dense part and lines of few points, 3 m apart: what lies between them is not surface."""
        rng = np.random.default_rng(0)
        dense = np.column_stack([rng.uniform(0, 4, 1200), rng.normal(0, 0.01, 1200), rng.uniform(0, 3, 1200)])
        line, x = np.repeat(np.arange(3, 24, 3), 60), rng.uniform(0, 30, 420)
        lines = np.column_stack([x, rng.normal(0, 0.01, 420), line + rng.normal(0, 0.02, 420)])
        features = patch_features(make_patches([np.vstack([dense, lines])], [(0.0, 1.0, 0.0)]))
        assert 8.0 < features.shape[0, features.shape_names.index("area_m2")] < 40.0
