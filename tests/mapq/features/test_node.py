"""Node features and the measures in metres against brute force."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.features import FeatureSettings, measure_shapes, patch_features
from tests.mapq.factories import Rectangle, make_patches, sample_patches, turn, wall
from tests.reference.mapq_features import mean_squared_error, spread

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
