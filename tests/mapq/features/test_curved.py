"""Curved patches are measured along their local normals; planes as if there were none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data.true_ranges import true_ranges
from mapq.axes import turn_cloud
from mapq.configuration import AS_IT_IS, SURFACES, Configuration, FeatureSettings, TileSettings
from mapq.features import measure_shapes, patch_features
from mapq.io import write_cloud
from mapq.io.patches import read_patches, write_patches
from mapq.io.tiles import open_map
from mapq.patches import Patches
from mapq.segmentation import segment
from mapq.tiled.run import cut_map
from tests.mapq.columns import CURVED, HEIGHT, N_SCANS, NOISE, scanned
from tests.mapq.factories import sample_patches, wall

IS_CURVED = SURFACES.index("curved")


@pytest.fixture(scope="module")
def room() -> Patches:
    return segment(scanned(), CURVED)


def test_planes_are_measured_to_the_last_bit_as_if_nothing_could_bend():
    patches = sample_patches([wall((0, 0), (8, 0)), wall((8, 0.3), (0, 0.3)), wall((8, 0), (8, 6))])
    one, other = patch_features(patches), patch_features(replace(patches, bend=np.zeros((3, 3))))
    for name in ("node", "edge", "plausibility", "shape"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_thickness_is_that_of_the_noise_and_width_goes_round_the_axis(room):
    shapes = measure_shapes(room)
    curved = np.flatnonzero(room.kinds == IS_CURVED)
    assert np.sqrt(shapes.mse[curved]) == pytest.approx(NOISE, rel=0.1)
    assert shapes.thickness[curved] == pytest.approx(3.3 * NOISE, rel=0.1)
    around = 2.0 * np.pi / shapes.bend[curved]
    assert shapes.width[curved] == pytest.approx(around, rel=0.05)
    assert shapes.area[curved] == pytest.approx(around * HEIGHT, rel=0.15)
    places = shapes.points[shapes.start[curved[0]] : shapes.start[curved[0] + 1]]
    normals = shapes.normals_at(np.full(len(places), curved[0]), places)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_allclose(normals @ shapes.along[curved[0]], 0.0, atol=1e-9)


def test_neither_order_nor_quarter_turns_matter(room):
    known = patch_features(room)
    order = np.random.default_rng(2).permutation(len(room.cloud))
    others = [(room.cloud.take(order), 0.0), *((turn_cloud(room.cloud, quarter), 1e-9) for quarter in (1, 2))]
    for cloud, tolerance in others:
        other = patch_features(segment(cloud, CURVED))
        np.testing.assert_array_equal(other.pairs, known.pairs)
        np.testing.assert_allclose(other.node, known.node, rtol=0, atol=tolerance)
        np.testing.assert_allclose(other.edge, known.edge, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    "shift",
    [
        (0.0, 0.0),
        pytest.param((0.1, 0.0), marks=pytest.mark.slow),
        (0.12, -0.16),
        pytest.param((0.0, 0.3), marks=pytest.mark.slow),
    ],
)
def test_scans_that_see_a_column_from_all_sides_are_apart_by_their_shift(shift):
    patches = segment(scanned(shift), CURVED)
    found = patch_features(patches, FeatureSettings(noise=NOISE, context=("moments",))).disagreement
    moved = np.tile(np.eye(4), (N_SCANS, 1, 1))
    moved[1::2, :2, 3] = shift
    shifted = (patches.cloud.fields["scan"] % 2)[:, None] * [*shift, 0.0]
    truth = true_ranges(patches, patches.cloud.xyz - shifted, moved)
    curved = (patches.kinds == IS_CURVED) & (patches.counts > 300)
    assert curved.sum() >= 2
    size = np.hypot(*shift)
    assert np.median(truth[curved]) == pytest.approx(size, abs=0.01)
    assert found[curved, 1] == pytest.approx(truth[curved], abs=0.02)
    assert (found[curved, 0] <= truth[curved]).all()
    assert (truth[curved] <= found[curved, 2]).all()


def test_files_keep_axes_and_those_without_hold_planes(room, tmp_path):
    write_patches(tmp_path / "a.patches", room)
    again = read_patches(tmp_path / "a.patches")
    np.testing.assert_array_equal(again.bend, room.bend)
    np.testing.assert_array_equal(again.kinds, room.kinds)
    write_patches(tmp_path / "b.patches", replace(room, bend=None))
    assert not (read_patches(tmp_path / "b.patches").kinds == IS_CURVED).any()


def test_a_map_in_tiles_has_the_same_columns(room, tmp_path):
    write_cloud(tmp_path / "room.ply", room.cloud)
    settings = Configuration(tiles=TileSettings(tile_points=len(room.cloud) // 4), segment=CURVED)
    cut = cut_map(open_map(str(tmp_path / "room.ply"), AS_IT_IS), settings, map, str(tmp_path))
    assert len(cut.tiling.boxes) > 2
    one, other = (each.bend[each.kinds == IS_CURVED] for each in (room, cut.patches))
    lengths = [np.sort(np.linalg.norm(each, axis=1)) for each in (one, other)]
    assert lengths[1] == pytest.approx(lengths[0], rel=0.02)
