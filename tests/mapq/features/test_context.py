"""Context: what looks like an error of the map, told from what is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import FeatureSettings, patch_features
from mapq.features.context import EDGE_COLUMNS, NODE_COLUMNS
from mapq.features.pairs import EDGE_NAMES
from mapq.features.provenance import known_of, moments_of
from mapq.features.settings import CONTEXTS
from mapq.features.shape import NODE_NAMES
from mapq.patches import Patches
from tests.mapq.factories import always_known, make_patches, sample_patches, wall

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
    def test_scans_outrank_times_and_times_passes(self):
        cloud = seen(sample_patches(DOUBLE, 1, DENSITY, NOISE), [(5, -5, 1)] * 2, [0, 1]).cloud
        assert known_of(cloud).moment == "pass_id"
        cloud = cloud.with_fields(time=np.linspace(0, 12, len(cloud)))
        assert known_of(cloud).moment == "time"
        assert known_of(cloud.with_fields(scan=np.zeros(len(cloud), np.int32))).moment == "scan"

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
    def test_fields_without_information_are_ignored(self, fields):
        cloud = PointCloud(np.zeros((10, 3)), np.zeros(3), fields)
        assert moments_of(cloud, np.arange(10), known_of(cloud)) is None


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

    @pytest.mark.parametrize("walls", [[], DOUBLE[:1]])
    def test_maps_without_pairs(self, walls):
        patches = sample_patches(walls, 1, 20.0, NOISE) if walls else make_patches([], np.empty((0, 3)), loose=3)
        way = np.ones((len(patches.cloud), 3))
        fields = {f"to_sensor_{axis}": way[:, k] for k, axis in enumerate("xyz")}
        patches = replace(patches, cloud=patches.cloud.with_fields(**fields, pass_id=np.arange(len(way)) % 2))
        found = patch_features(patches)
        assert found.edge.shape == (0, len(found.edge_names))
        assert np.isfinite(always_known(found)).all()
