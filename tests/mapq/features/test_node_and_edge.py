"""Pairs of rectangles: table 1 of the paper, and equations 9 to 13 against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.configuration import FeatureSettings
from mapq.features import measure_shapes, patch_features
from mapq.patches import Patches
from tests.mapq.factories import Rectangle, always_known, make_patches, sample_patches, turn, wall
from tests.reference.mapq_features import (
    Sheet,
    ideal_overlap,
    mean_squared_error,
    safe_crossing,
    safe_overlap,
    spread,
)

LONG = wall((-5, 0), (5, 0))


def crossing_wall(degrees: float, middle: float = 0.0, length: float = 10.0) -> Rectangle:
    """Return a wall whose middle stands on `LONG`, turned by an angle."""
    c, s = np.cos(np.radians(degrees)) * length / 2, np.sin(np.radians(degrees)) * length / 2
    return wall((middle - c, -s), (middle + c, s))


PLAUSIBLE = {
    "corner": [LONG, wall((5, 0), (5, 10))],
    "corner of 60 degrees": [LONG, wall((5, 0), (0, 8.66))],
    "corner of 30 degrees": [LONG, wall((5, 0), (-3.66, 5))],
    "corner of 120 degrees": [LONG, wall((5, 0), (10, 8.66))],
    "bend of 10 degrees": [LONG, wall((5, 0), (14.85, 1.74))],
    "T": [LONG, wall((0, 0), (0, 10))],
    "wall on the ground": [LONG, Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0), 30, 30)],
    "neither parallel nor meeting": [LONG, wall((0, 1), (6, 4.5))],
    "upright to it, not meeting": [LONG, wall((0, 1), (0, 8))],
    "fragments side by side": [LONG, wall((5, 0), (15, 0))],
    "fragments above one another": [LONG, wall((-5, 0), (5, 0), foot=4)],
    "fragments that interleave": [LONG, wall((-4, 0.01), (6, 0.01))],
    "window in a recess": [wall((-5, 0), (0, 0)), wall((0, 0.25), (2, 0.25))],
}
FAR = [LONG, wall((-5, 2.8), (5, 2.8))]
"""Parallel and far: within the radius of 3 m, where it is the weight alone that speaks for them."""
SUSPICIOUS = {
    "parallel, 0.1 m": [LONG, wall((-5, 0.1), (5, 0.1))],
    "parallel, 0.3 m, also as the two sides of a wall": [LONG, wall((-5, 0.3), (5, 0.3))],
    "parallel, half beside one another": [LONG, wall((0, 0.3), (10, 0.3))],
    "parallel, short by long": [LONG, wall((-1, 0.3), (1, 0.3))],
    "parallel, 1 m": [LONG, wall((-5, 1), (5, 1))],
    "X": [LONG, crossing_wall(90)],
    "X, not in the middle": [LONG, crossing_wall(90, 2.0)],
    **{f"X of {angle} degrees": [LONG, crossing_wall(angle)] for angle in (1, 2, 3, 5, 10, 20, 45)},
    "X of 3 degrees, not in the middle": [LONG, crossing_wall(3, 3.0)],
}


def x_of(rectangles: list[Rectangle], settings: FeatureSettings | None = None, seed: int = 0) -> float:
    features = patch_features(sample_patches(rectangles, seed), settings)
    assert features.pairs.tolist() == [[0, 1]]
    return float(features.plausibility[0])


def edge_of(rectangles: list[Rectangle], name: str, settings: FeatureSettings | None = None) -> float:
    features = patch_features(sample_patches(rectangles), settings)
    return float(features.edge[0, features.edge_names.index(name)])


def jittered(rectangle: Rectangle, spacing: float, noise: float = 0.005, seed: int = 0) -> np.ndarray:
    """Return points of a rectangle, one a square: as even as a map thinned by voxels."""
    rng = np.random.default_rng(seed)
    n = np.round(np.array([rectangle.width, rectangle.height]) / spacing).astype(int)
    places = np.indices(n).reshape(2, -1).T + rng.uniform(0.1, 0.9, (n.prod(), 2))
    offset = rng.normal(0.0, noise, n.prod())
    flat = (places / n - 0.5) * [rectangle.width, rectangle.height]
    return np.array(rectangle.middle) + np.column_stack([flat, offset]) @ rectangle.axes


def in_windows(points: np.ndarray) -> np.ndarray:
    """Return the window (n,) of each point of a wall along x, -1 for none: eight of 1.4 by 1.6 m."""
    window = np.full(len(points), -1)
    for k, (x, z) in enumerate((x, z) for x in (-4.5, -1.5, 1.5, 4.5) for z in (1.6, 4.4)):
        window[(np.abs(points[:, 0] - x) < 0.7) & (np.abs(points[:, 2] - z) < 0.8)] = k
    return window


def sheets_of(patches: Patches) -> list[Sheet]:
    shapes = measure_shapes(patches)
    axes = np.stack([shapes.across, shapes.along, shapes.normal], axis=1)
    points = np.split(shapes.points, shapes.start[1:-1])
    return [Sheet(*one) for one in zip(points, shapes.centre, axes, shapes.cell, shapes.area, strict=True)]


class TestTable1:
    @pytest.mark.parametrize("name", PLAUSIBLE)
    def test_plausible_pairs(self, name):
        assert x_of(PLAUSIBLE[name]) > 0.85

    @pytest.mark.parametrize("name", SUSPICIOUS)
    def test_suspicious_pairs(self, name):
        assert x_of(SUSPICIOUS[name]) < 0.7

    def test_the_ranking(self):
        plausible, suspicious = ([x_of(pair) for pair in table.values()] for table in (PLAUSIBLE, SUSPICIOUS))
        assert max(suspicious) < x_of(FAR) < min(plausible)
        assert x_of(FAR) > 0.7
        assert x_of(FAR, FeatureSettings(tau=1.0)) > 0.85

    def test_parallel_ones_grow_plausible_with_their_distance_and_end_at_the_radius(self):
        x = [x_of([LONG, wall((-5, y), (5, y))]) for y in (0.15, 0.3, 0.6, 1.0, 1.5, 2.0, 2.8)]
        assert (np.diff(x) > 0.01).all()
        assert len(patch_features(sample_patches([LONG, wall((-5, 3.2), (5, 3.2))])).pairs) == 0

    def test_nothing_depends_on_how_the_pair_lies(self):
        for rectangles in (*SUSPICIOUS.values(), *PLAUSIBLE.values()):
            patches = sample_patches(rectangles)
            rotated = make_patches(
                [patches.cloud.xyz[patches.patch == k] @ turn(33.0).T for k in (0, 1)], patches.normal @ turn(33.0).T
            )
            one, two = patch_features(patches), patch_features(rotated)
            assert one.plausibility == pytest.approx(two.plausibility, abs=1e-6)


class TestOverlap:
    @pytest.mark.parametrize("name", [*SUSPICIOUS, *PLAUSIBLE])
    def test_is_that_of_brute_force(self, name):
        patches = sample_patches({**SUSPICIOUS, **PLAUSIBLE}[name], density=8)
        features = patch_features(patches, FeatureSettings(tau=1.5))
        edge = dict(zip(features.edge_names, features.edge[0], strict=True))
        found = safe_overlap(*sheets_of(patches), radius=3.0, tau=1.5, tolerance=features.parameters["tolerance"])
        assert (edge["overlap"], edge["overlap_area"]) == pytest.approx(found, abs=1e-9)

    @pytest.mark.parametrize("name", [*SUSPICIOUS, "corner of 30 degrees", "fragments that interleave", "T"])
    def test_is_nearly_that_of_surfaces_without_gaps(self, name):
        """But for the margin, about a gap wide, that points at the edge of the other patch do not surround."""
        one, other = {**SUSPICIOUS, **PLAUSIBLE}[name]
        shapes = [(np.array(r.middle), r.axes, r.width, r.height) for r in (one, other)]
        expected = ideal_overlap(*shapes, tau=1.0, tolerance=0.05, steps=120)
        points = [jittered(one, 0.07, seed=1), jittered(other, 0.07, seed=2)]
        features = patch_features(
            make_patches(points, [one.axes[2], other.axes[2]]),
            FeatureSettings(radius=20.0, tau=1.0),
        )
        assert features.edge[0, features.edge_names.index("overlap")] == pytest.approx(expected, abs=0.08)

    def test_it_does_not_matter_where_the_cells_begin(self):
        """Sparse and uneven points, whose gaps are as large as the cells; another sign of a normal moves the cells."""
        rng = np.random.default_rng(5)
        for _ in range(20):
            scan = np.column_stack([np.tan(rng.uniform(-1.3, 1.3, 90)), np.zeros(90), 3 * rng.random(90) ** 3])
            points = [scan * rng.uniform(0.5, 2, 3) + [0, y, 0] for y in (0.0, 0.2)]
            normals = np.array([[0.0, 1.0, 0.0]] * 2)
            one, other = (patch_features(make_patches(points, k * normals)) for k in (1, -1))
            np.testing.assert_allclose(one.edge, other.edge, rtol=1e-9, atol=1e-9)

    @pytest.mark.parametrize("gap", [0.0, 1e-9])
    def test_rounding_does_not_decide_over_exact_copies(self, gap):
        """Points that lie at the very place are on no side of it."""
        points = np.random.default_rng(0).uniform(0, 1, (400, 3)) * [6, 0, 3]
        found = [
            patch_features(make_patches([points, points + np.array([gap, 0.3, 0])], [[0.0, 1, 0], [0.0, k, 0]])).edge[
                0, 2
            ]
            for k in (1, -1)
        ]
        exact = patch_features(make_patches([points, points + np.array([0, 0.3, 0])], [[0.0, 1, 0]] * 2)).edge[0, 2]
        assert found == pytest.approx([exact] * 2, abs=1e-6)

    @pytest.mark.parametrize("whole", [False, True], ids=["pane by pane", "all panes one patch"])
    @pytest.mark.parametrize("deep", [0.15, 0.25, 0.4])
    def test_recessed_panes_do_not_lie_over_their_facade(self, deep, whole):
        front = jittered(wall((-6, 0), (6, 0), height=6), 0.12, 0.02)
        window = in_windows(front)
        window[(window >= 0) & whole] = 0
        behind = [front[window == k] + [0, deep, 0] for k in range(window.max() + 1)]
        features = patch_features(make_patches([front[window < 0], *behind], [[0.0, 1.0, 0.0]] * (1 + len(behind))))
        of_facade = features.pairs[:, 0] == 0
        assert of_facade.sum() == len(behind)
        assert features.edge[of_facade, features.edge_names.index("overlap")].max() < 0.15

    def test_a_doubled_facade_does_windows_and_all(self):
        points = [jittered(wall((-6, y), (6, y), height=6), 0.12, 0.02, seed=k) for k, y in enumerate((0.0, 0.3))]
        patches = make_patches([p[in_windows(p) < 0] for p in points], [[0.0, 1.0, 0.0]] * 2)
        assert patch_features(patches).edge[0, 2] > 0.5

    @pytest.mark.parametrize(("offset", "share"), [(0.025, 0.0), (0.0375, 0.1), (0.05, 0.5), (0.0667, 0.9), (0.1, 1.0)])
    def test_counts_by_a_steep_ramp_at_the_tolerance(self, offset, share):
        # Without noise the tolerance is the 5 cm of the settings; at four times that all of it counts.
        pairs = [sample_patches([LONG, wall((-5, y), (5, y))], noise=0.0) for y in (offset, 0.2)]
        found, in_full = (patch_features(patches).edge[0, 2] for patches in pairs)
        assert found / in_full == pytest.approx(share, abs=0.015)

    def test_windows_do_not_count(self):
        rng = np.random.default_rng(0)
        front = LONG.sample(rng, 200.0)
        hole = (np.abs(front[:, 0]) < 3) & (np.abs(front[:, 2] - 2) < 1.5)
        behind = wall((-2.5, 0.3), (2.5, 0.3), height=2.0, foot=1.0)
        patches = make_patches([front[~hole], behind.sample(rng, 200.0)], [LONG.axes[2], behind.axes[2]])
        features = patch_features(patches)
        assert features.edge[0, features.edge_names.index("overlap")] == 0.0

    def test_scan_lines_make_no_holes(self):
        heights = np.arange(0.1, 4.0, 0.25)
        along = np.arange(-5, 5, 0.02)
        lines = np.array([(x, y, z) for y in (0.0, 0.3) for z in heights + 0.4 * y for x in along])
        normal = [0.0, 1.0, 0.0]
        patches = make_patches([lines[lines[:, 1] == 0], lines[lines[:, 1] > 0]], [normal, normal])
        features = patch_features(patches, FeatureSettings(noise=0.02))
        assert features.edge[0, features.edge_names.index("overlap")] > 0.9

    def test_offset_and_area_in_metres(self):
        rectangles = SUSPICIOUS["parallel, half beside one another"]
        assert edge_of(rectangles, "offset") == pytest.approx(0.3, abs=0.005)
        assert edge_of(rectangles, "overlap_area") == pytest.approx(17.0, rel=0.16), "20 but for what is not surrounded"
        assert edge_of(PLAUSIBLE["corner"], "overlap_area") == 0.0
        assert edge_of(PLAUSIBLE["corner"], "offset") == pytest.approx(0.0, abs=0.1)


class TestCrossing:
    @pytest.mark.parametrize(("noise", "beyond"), [(0.01, 0.05), (0.04, 3.3 * 0.04)])
    @pytest.mark.parametrize("name", [*PLAUSIBLE, *SUSPICIOUS])
    def test_is_that_of_brute_force(self, name, noise, beyond):
        patches = sample_patches({**SUSPICIOUS, **PLAUSIBLE}[name])
        settings = FeatureSettings(noise=noise, spacing=0.1)
        features = patch_features(patches, settings)
        parallel = np.linalg.norm(np.cross(*patches.normal)) < 1e-6
        expected = 0.0 if parallel else safe_crossing(*sheets_of(patches), 0.1, beyond)
        assert features.edge[0, features.edge_names.index("crossing")] == pytest.approx(expected, abs=1e-9)

    def test_a_line_that_noise_does_not_fix_is_no_crossing(self):
        assert edge_of([LONG, crossing_wall(0.2)], "crossing") == 0.0


class TestWeight:
    def test_falls_with_the_distance_beyond_the_spacing(self):
        features = patch_features(sample_patches(SUSPICIOUS["parallel, 1 m"]), FeatureSettings(tau=0.5, spacing=0.2))
        shapes = measure_shapes(sample_patches(SUSPICIOUS["parallel, 1 m"]))
        separation, weight = features.edge[0, :2]
        assert 0.6 < separation < 0.8
        assert weight == pytest.approx(np.exp(-separation / 0.5))
        assert shapes.spacing == pytest.approx(60**-0.5, rel=0.1)


@given(
    st.integers(0, 10**6),
    st.floats(-180, 180),
    st.floats(0.05, 12),
    st.floats(0.05, 6),
    st.sampled_from([0.0, 0.02, 0.3]),
)
def test_every_pair_is_finite_and_within_its_range(seed, degrees, width, height, noise):
    rng = np.random.default_rng(seed)
    axis = turn(degrees) @ [1.0, 0.0, rng.normal(0, 0.3)]
    other = Rectangle(tuple(rng.normal(0, 1, 3)), tuple(axis), tuple(rng.normal(size=3)), width, height)
    patches = sample_patches([LONG, other], seed, density=rng.choice([0.2, 5.0, 40.0]), noise=noise)
    features = patch_features(patches, FeatureSettings(radius=20.0))
    assert np.isfinite(always_known(features)).all()
    assert np.isfinite(features.edge).all()
    assert np.isfinite(features.shape).all()
    columns = dict(zip(features.edge_names, features.edge.T, strict=True))
    for name in ("weight", "overlap", "crossing"):
        assert ((columns[name] >= 0) & (columns[name] <= 1)).all()
    assert (np.abs(features.plausibility) <= 1).all()


# Node features and the measures in metres against brute force.


TILTED = Rectangle((3, 1, 2), (1, 2, 0), (0.3, 0, 1), 7, 3)


def test_features_are_those_of_brute_force():
    rectangles = [wall((0, 0), (8, 3)), TILTED, Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))]
    patches = sample_patches(rectangles, noise=0.03)
    features = patch_features(patches, FeatureSettings(eps=0.02))
    noise = float(np.median([np.sqrt(mean_squared_error(patches.cloud.xyz[patches.patch == k])) for k in range(3)]))
    for k, rectangle in enumerate(rectangles):
        points, normal = patches.cloud.xyz[patches.patch == k], rectangle.axes[2]
        fit = -np.log((mean_squared_error(points) + 0.02**2) / (noise**2 + 0.02**2))
        thickness = -np.log((0.02 + spread(points, normal)) / (0.02 + noise))
        assert features.node[k, :3] == pytest.approx([fit, 1 - abs(normal[2]), thickness], rel=1e-9)


def test_measures_in_metres():
    patches = sample_patches([wall((0, 0), (8, 3)), TILTED], noise=0.03)
    shape = dict(zip(patch_features(patches).shape_names, patch_features(patches).shape.T, strict=True))
    assert shape["n_points"].tolist() == patches.counts.tolist()
    assert shape["rms_m"] == pytest.approx([0.03, 0.03], rel=0.05)
    assert shape["thickness_m"] == pytest.approx([3.29 * 0.03] * 2, rel=0.1)
    assert shape["width_m"] == pytest.approx([73**0.5, 7.0], rel=0.01)
    assert shape["height_m"] == pytest.approx([4.0, 3.0], rel=0.01)
    assert shape["area_m2"] == pytest.approx([4 * 73**0.5, 21.0], rel=0.12)
    assert shape["tilt_deg"] == pytest.approx([0.0, np.degrees(np.arcsin(abs(TILTED.axes[2, 2])))], abs=1e-9)


def test_up_of_the_segmentation_and_of_the_settings():
    patches = make_patches([wall((0, 0), (5, 0)).sample(np.random.default_rng(0))], [[0.0, 1.0, 0.0]])
    assert patch_features(patches).node[0, 1] == 1.0
    assert patch_features(patches, FeatureSettings(up=(0.0, 2.0, 0.0))).node[0, 1] == 0.0
    patches.parameters["up"] = [0.0, 1.0, 0.0]  # type: ignore[index] # a dict of our own making
    assert patch_features(patches).node[0, 1] == 0.0


def test_level_planes_have_the_longer_side_across():
    level = sample_patches([Rectangle((0, 0, 0), tuple(turn(25) @ [1, 0, 0]), tuple(turn(25) @ [0, 1, 0]), 12, 5)])
    shapes = measure_shapes(level)
    assert abs(shapes.across[0] @ turn(25) @ [1, 0, 0]) == pytest.approx(1.0, abs=1e-3)
    assert (shapes.width[0], shapes.height[0]) == pytest.approx((12, 5), rel=0.02)


@pytest.mark.parametrize("gap", [0.05, 0.1, 0.25])
def test_cells_span_the_gaps_of_scan_lines(gap):
    heights = np.arange(0, 4, gap)
    points = np.array([(x, 0.0, z) for z in heights for x in np.arange(0, 10, 0.02)])
    shapes = measure_shapes(make_patches([points], [[0.0, 1.0, 0.0]]))
    assert 0.5 * gap <= shapes.cell[0] <= 2.1 * gap
    assert shapes.area[0] == pytest.approx(40.0, rel=0.15)


def test_area_leaves_windows_out():
    points = wall((0, 0), (10, 0)).sample(np.random.default_rng(1), 100.0)
    hole = (np.abs(points[:, 0] - 5) < 2.5) & (np.abs(points[:, 2] - 2) < 1)
    shapes = measure_shapes(make_patches([points[~hole]], [[0.0, 1.0, 0.0]]))
    assert shapes.area[0] == pytest.approx(30.0, rel=0.12)
