"""Context: what looks like an error of the map, told from what is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import FeatureSettings, patch_features
from mapq.features.context import EDGE_COLUMNS, NODE_COLUMNS
from mapq.features.edge import EDGE_NAMES
from mapq.features.node import NODE_NAMES
from mapq.features.provenance import known_of, moments_of, views_of
from mapq.features.settings import CONTEXTS
from mapq.patches import Patches
from prf.shell.errors import ConfigError
from tests.mapq.factories import always_known, make_patches, sample_patches, shuffled, wall

DENSITY, NOISE = 60.0, 0.01


def seen(patches: Patches, sensors, passes, times=None) -> Patches:
    """Return the patches with passes, times and the way to the sensor of each patch."""
    sensor = np.asarray(sensors, np.float64)[patches.patch]
    way = (sensor - patches.cloud.xyz).astype(np.float32)
    fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
    fields["pass_id"] = np.asarray(passes, np.int16)[patches.patch]
    if times is not None:
        fields["time"] = np.asarray(times, np.float64)[patches.patch] + np.arange(len(patches.patch)) % 13
    return replace(patches, cloud=patches.cloud.with_fields(**fields))


def pair(patches: Patches, i: int = 0, j: int = 1, **settings) -> dict[str, float]:
    """Return the edge features of a pair, context divided by the conflict that it explains."""
    found = patch_features(patches, FeatureSettings(**settings))
    (row,) = np.flatnonzero((found.pairs == (i, j)).all(axis=1))
    values = dict(zip(found.edge_names, found.edge[row].tolist(), strict=True))
    conflict = max(1.0 - found.plausibility[row], 1e-12)
    return {name: value / conflict if name in found.context_names else value for name, value in values.items()}


def node(patches: Patches, name: str) -> np.ndarray:
    found = patch_features(patches)
    return found.node[:, found.node_names.index(name)]


DOUBLE = [wall((0, 2), (10, 2)), wall((0, 2.4), (10, 2.4))]
FENCE = [wall((0, 2), (10, 2), 6.0), wall((2, 1.5), (7, 1.5), 1.2)]


class TestOutlines:
    def test_a_fence_covers_little_of_the_facade_behind_it(self):
        fence, double = (pair(sample_patches(walls, 1, DENSITY, NOISE)) for walls in (FENCE, DOUBLE))
        assert fence["overlap"] > 0.7
        assert fence["partly_covered"] > 0.8
        assert double["partly_covered"] < 0.25
        assert fence["unlike_height"] == pytest.approx(0.8, abs=0.05)
        assert double["unlike_height"] < 0.05


class TestMoments:
    def test_what_one_visit_sees_twice_is_twice_there(self):
        patches = sample_patches(DOUBLE, 1, DENSITY, NOISE)
        sensor = [(5, -5, 1)] * 2
        for times, expected in (([0.0, 0.0], 1.0), ([0.0, 300.0], -1.0)):
            found = pair(seen(patches, sensor, [0, 0], times))["seen_together"]
            assert found == pytest.approx(expected, abs=0.01)

    def test_scans_outrank_times_and_times_passes(self):
        patches = sample_patches(DOUBLE, 1, DENSITY, NOISE)
        by_pass = seen(patches, [(5, -5, 1)] * 2, [0, 1])
        assert pair(by_pass)["seen_together"] == pytest.approx(-1.0, abs=0.01)
        by_time = seen(patches, [(5, -5, 1)] * 2, [0, 1], [0.0, 0.0])
        by_time = replace(by_time, cloud=by_time.cloud.with_fields(time=np.linspace(0, 12, len(by_time.cloud))))
        assert pair(by_time)["seen_together"] == pytest.approx(1.0, abs=0.01)
        scan = np.arange(len(by_time.cloud)) % 2 + 2 * by_time.patch
        by_scan = replace(by_time, cloud=by_time.cloud.with_fields(scan=scan.astype(np.int32)))
        assert pair(by_scan)["seen_together"] == pytest.approx(-1.0, abs=0.01)

    def test_points_that_strayed_into_a_copy_do_not_make_it_seen_together(self):
        patches = sample_patches(DOUBLE, 1, DENSITY, NOISE)
        scan = np.where(np.arange(len(patches.patch)) % 12 == 0, 0, patches.patch)
        found = pair(replace(patches, cloud=patches.cloud.with_fields(scan=scan)))["seen_together"]
        assert found == pytest.approx(-1.0 + 2.0 / 12.0, abs=0.03)

    @pytest.mark.parametrize(
        "fields",
        [
            {},
            {"pass_id": np.zeros(10)},
            {"pass_id": np.full(10, 0.5)},
            {"time": np.linspace(0, 0.1, 10)},
            {"time": np.full(10, np.nan)},
            {"scan": np.zeros((10, 2))},
        ],
    )
    def test_fields_that_say_nothing_are_passed_over(self, fields):
        cloud = PointCloud(np.zeros((10, 3)), np.zeros(3), fields)
        assert moments_of(cloud, np.arange(10), known_of(cloud)) is None

    def test_one_scan_sees_all_at_once(self):
        patches = sample_patches(DOUBLE, 1, DENSITY, NOISE)
        patches = replace(patches, cloud=patches.cloud.with_fields(scan=np.full(len(patches.cloud), 7)))
        assert pair(patches)["seen_together"] == pytest.approx(1.0)


class TestRays:
    def test_the_front_copy_of_a_wall_is_seen_through(self):
        patches = seen(sample_patches(DOUBLE, 1, DENSITY, NOISE), [(5, -5, 1)] * 2, [0, 1])
        front, back = node(patches, "seen_through")
        assert front > 0.7
        assert back == 0.0
        assert pair(patches)["through_conflict"] == pytest.approx(front)

    def test_what_its_own_pass_sees_through_is_a_fence(self):
        points = _points(DOUBLE)
        both = np.vstack([points[1], points[1]])
        patches = make_patches([points[0], both], [(0, 1, 0), (0, 1, 0)])
        patches = seen(patches, [(5, -5, 1)] * 2, [0, 0])
        passes = np.concatenate([np.zeros(len(points[0])), np.arange(len(both)) >= len(points[1])]).astype(np.int16)
        patches = replace(patches, cloud=patches.cloud.with_fields(pass_id=passes))
        assert node(patches, "seen_through")[0] < 0.1

    def test_what_other_passes_hit_as_well_is_there(self):
        points = _points(DOUBLE)
        patches = make_patches([np.vstack([points[0]] * 2), points[1]], [(0, 1, 0), (0, 1, 0)])
        passes = np.concatenate([np.arange(2 * len(points[0])) >= len(points[0]), np.ones(len(points[1]))])
        patches = seen(patches, [(5, -5, 1)] * 2, [0, 0])
        patches = replace(patches, cloud=patches.cloud.with_fields(pass_id=passes.astype(np.int16)))
        assert node(patches, "seen_through")[0] == pytest.approx(0.5, abs=0.1)

    def test_without_passes_there_is_no_evidence(self):
        patches = seen(sample_patches(DOUBLE, 1, DENSITY, NOISE), [(5, -5, 1)] * 2, [0, 0])
        assert node(patches, "seen_through").tolist() == [0.0, 0.0]

    def test_rays_that_are_followed_agree_with_the_definition(self):
        """Each ray against each voxel, without a walk."""
        from mapq.features.rays import _voxels, voxel_side
        from mapq.features.shape import measure_shapes
        from mapq.kernels.rays import count_rays

        rng = np.random.default_rng(3)
        patches = seen(sample_patches(DOUBLE, 2, 8.0, NOISE), [(5, -5, 1)] * 2, [0, 1])
        shapes = measure_shapes(patches)
        views = views_of(patches.cloud, shapes.number, known_of(patches.cloud))
        voxels = _voxels(shapes, views.seen_by.astype(np.int64), 2, voxel_side(shapes.spacing))
        origin, hit = rng.uniform((-2, -4, -1), (12, 1, 5), (200, 3)), rng.uniform((-2, -2, -1), (12, 6, 5), (200, 3))
        seen_by = rng.integers(0, 2, 200)
        counts = np.zeros((len(voxels.key), 2), np.int64)
        count_rays(voxels, shapes.planes, origin, hit, seen_by, 0.1, counts)
        expected = np.zeros_like(counts)
        low = np.array([[(key >> shift) & (2**21 - 1) for shift in (42, 21, 0)] for key in voxels.key]) - 2**20
        for o, h, by in zip(origin, hit, seen_by, strict=True):
            for k, corner in enumerate(low):
                n, c = shapes.planes.normal[voxels.patch[k]], shapes.planes.centre[voxels.patch[k]]
                before, after = (o - c) @ n, (h - c) @ n
                steep = abs(before - after) >= 0.1 * np.linalg.norm(h - o)
                if steep and before * after < 0 and min(abs(before), abs(after)) > 0.1:
                    q = o + before / (before - after) * (h - o)
                    inside = (np.floor(q / voxels.side) == corner).all()
                    expected[k, int(voxels.seen_by[k] != by)] += inside
        np.testing.assert_array_equal(counts, expected)
        assert expected.sum() > 20


def _points(walls):
    patches = sample_patches(walls, 1, DENSITY, NOISE)
    return [patches.cloud.xyz[patches.patch == k] for k in range(len(walls))]


class TestGroups:
    def test_each_can_be_measured_alone(self):
        patches = sample_patches(FENCE, 1, 20.0, NOISE)
        every = patch_features(patches)
        for name in CONTEXTS:
            one = patch_features(patches, FeatureSettings(context=(name,)))
            assert one.edge_names == (*EDGE_NAMES, *EDGE_COLUMNS.get(name, ()))
            assert one.node_names == (*NODE_NAMES, *NODE_COLUMNS.get(name, ()))
            assert one.context_names == EDGE_COLUMNS.get(name, ())
            for column in EDGE_COLUMNS.get(name, ()):
                np.testing.assert_array_equal(
                    one.edge[:, one.edge_names.index(column)], every.edge[:, every.edge_names.index(column)]
                )

    def test_the_literal_reading_has_none(self):
        found = patch_features(sample_patches(FENCE, 1, 20.0, NOISE), FeatureSettings(reading="literal"))
        assert (found.edge_names, found.context_names) == (EDGE_NAMES, ())
        assert found.parameters["context"] == []

    def test_what_a_map_does_not_tell_is_nought(self):
        found = patch_features(sample_patches(DOUBLE, 1, 20.0, NOISE))
        for name in ("seen_together", "through_conflict", "facing_away"):
            assert not found.edge[:, found.edge_names.index(name)].any()

    def test_a_group_that_there_is_not(self):
        with pytest.raises(ConfigError, match="no context colour"):
            FeatureSettings(context=("colour",))

    @pytest.mark.parametrize("walls", [[], DOUBLE[:1]])
    def test_maps_without_pairs(self, walls):
        patches = sample_patches(walls, 1, 20.0, NOISE) if walls else make_patches([], np.empty((0, 3)), loose=3)
        way = np.ones((len(patches.cloud), 3))
        fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
        patches = replace(patches, cloud=patches.cloud.with_fields(**fields, pass_id=np.arange(len(way)) % 2))
        found = patch_features(patches)
        assert found.edge.shape == (0, len(found.edge_names))
        assert np.isfinite(always_known(found)).all()

    def test_the_order_of_points_changes_nothing(self):
        patches = seen(sample_patches(DOUBLE + FENCE, 1, 20.0, NOISE), [(5, -5, 1)] * 4, [0, 1, 0, 1], [0, 99, 0, 99])
        one, other = patch_features(patches), patch_features(shuffled(patches))
        np.testing.assert_array_equal(one.edge, other.edge)
        np.testing.assert_array_equal(one.node, other.node)
