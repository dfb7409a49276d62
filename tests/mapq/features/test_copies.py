"""Copies of surfaces by points alone, on made-up walls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.features import FeatureSettings, measure_shapes
from mapq.features.copies import COLUMNS, FARTHEST, copy_columns, nearby_points
from mapq.kernels.copies import layers_over
from mapq.labels import NO_PATCH
from mapq.patches import Patches
from tests.mapq.factories import make_patches, moved, sample_patches, shuffled, turn, wall

DENSITY, NOISE = 60.0, 0.01
PLAN = [((0, 0), (8, 0)), ((8, 0), (8, 6)), ((0, 6), (8, 6)), ((0, 0), (0, 6))]
ROOM = [wall(*line) for line in PLAN]


def columns(patches: Patches, settings: FeatureSettings | None = None) -> dict[str, np.ndarray]:
    number = np.flatnonzero(patches.cloud.finite())
    near = nearby_points(patches, number, np.zeros(len(number), np.int64), None)
    return copy_columns(near, measure_shapes(patches), settings or FeatureSettings())


def loosened(patches: Patches, first: int) -> Patches:
    """Return the patches without those from number `first` on, whose points are in none."""
    patch = np.where(patches.patch < first, patches.patch, NO_PATCH).astype(np.int32)
    return Patches.unlabelled(patches.cloud, patch, patches.normal[:first], patches.centroid[:first], {}, {})


def doubled(by: tuple[float, float]):
    """Return the walls of a room, and all of them again."""
    return [*ROOM, *(wall(*(tuple(np.add(corner, by)) for corner in line)) for line in PLAN)]


class TestSecondLayer:
    @pytest.mark.parametrize("density", [15.0, 60.0, 400.0])
    @pytest.mark.parametrize("loose", [False, True])
    def test_a_doubled_wall_is_covered_whether_its_copy_is_a_patch_or_not(self, density, loose):
        patches = sample_patches([wall((0, 2), (10, 2)), wall((0, 2.4), (10, 2.4))], 1, density, NOISE)
        found = columns(loosened(patches, 1) if loose else patches)
        assert found["copy_cover"][0] > 0.8
        assert found["copy_even"][0] == pytest.approx(1.0, abs=0.1)
        # As dense as the wall, but for points over gaps of it.
        assert found["copy_density"][0] == pytest.approx(np.log(found["copy_cover"][0]), abs=0.05)

    def test_a_single_wall_has_none(self):
        found = columns(sample_patches([wall((0, 2), (10, 2)), wall((5, -1), (5, 5))], 1, DENSITY, NOISE))
        assert (found["copy_cover"] < 0.1).all()

    def test_clutter_before_a_wall_covers_little_and_unevenly(self):
        rng = np.random.default_rng(1)
        bush = rng.uniform((2, 0.8, 0), (5, 1.3, 1.5), (3000, 3))
        points = wall((0, 2), (10, 2)).sample(rng, DENSITY, NOISE)
        found = columns(loosened(make_patches([points, bush], [(0, 1, 0)] * 2), 1))
        assert found["copy_cover"][0] < 0.2
        assert found["copy_even"][0] < 0.5

    def test_two_faces_of_a_thin_wall_look_like_a_copy_but_the_rest_of_the_room_does_not_agree(self):
        thin = [*ROOM, wall((0.1, 3.0), (7.9, 3.0)), wall((0.1, 3.2), (7.9, 3.2))]
        one, all_ = (columns(sample_patches(walls, 1, DENSITY, NOISE)) for walls in (thin, doubled((0.4, 0.3))))
        assert one["copy_cover"][4:].min() > 0.8
        assert one["shift_here"].max() < 0.75 * all_["shift_here"].min()
        assert one["near_cover"].max() < 0.6 * all_["near_cover"].min()


class TestShift:
    def test_one_motion_explains_the_copies_of_all_walls(self):
        patches = sample_patches(doubled((0.4, 0.3)), 1, DENSITY, NOISE)
        for found in (columns(patches), columns(loosened(patches, 4))):
            assert found["shift_length"] == pytest.approx(0.5, abs=0.1)
            assert (found["shift_support"] > 0.5).all()

    def test_level_patches_do_not_constrain_horizontal_motions(self):
        floor = np.random.default_rng(1).uniform((0, 0, 0), (8, 6, 0.01), (3000, 3))
        found = columns(make_patches([floor], [(0, 0, 1)]))
        assert all(np.isnan(found[name]).all() for name in COLUMNS if name.startswith("shift"))


def test_no_patches_have_no_columns_and_coarse_noise_leaves_them_unknown():
    empty = make_patches([], [])
    assert {len(values) for values in columns(empty).values()} == {0}
    patches = sample_patches(ROOM, 1, DENSITY, NOISE)
    found = columns(patches, FeatureSettings(noise=0.5))
    assert all(np.isnan(values).all() for values in found.values())


@pytest.mark.parametrize("change", ["order", "shift", "signs", "turn"])
def test_order_shift_signs_and_turns_do_not_matter(change):
    patches = sample_patches(doubled((0.4, 0.3)), 1, DENSITY, NOISE)
    patches = loosened(patches, 6)
    other = {
        "order": lambda: shuffled(patches),
        "shift": lambda: moved(patches, np.eye(3), (12.3, -7.7, 3.1)),
        "signs": lambda: replace(patches, normal=patches.normal * np.array([[1], [-1], [-1], [1], [-1], [1]])),
        "turn": lambda: moved(patches, turn(37.0)),
    }[change]()
    expected, found = columns(patches), columns(other)
    for name in COLUMNS:
        assert found[name] == pytest.approx(expected[name], abs=0.05 if change == "signs" else 1e-6), name


def test_layers_agree_with_the_definition():
    """Each layer of each patch against each point, without voxels."""
    patches = loosened(sample_patches([*doubled((0.4, 0.3)), wall((2, 1), (6, 1), 1.2)], 1, 25.0, NOISE), 6)
    shapes, xyz = measure_shapes(patches), patches.cloud.xyz
    step, n_slices = 0.05, 2 * 30
    number = np.arange(len(xyz))
    near = nearby_points(patches, number, np.zeros(len(xyz), np.int64), None)
    cover, count, n_cells = layers_over(near, shapes.sheets, shapes.planes, shapes.points, shapes.start, step, n_slices)
    assert n_slices * step == pytest.approx(2 * FARTHEST)
    for i in range(len(patches)):
        away = xyz - shapes.centre[i]
        plan = np.column_stack([away @ shapes.across[i], away @ shapes.along[i]])
        own = patches.patch == i
        low, high = plan[own].min(axis=0), plan[own].max(axis=0)
        size = np.floor((high - low) / shapes.cell[i]) + 1
        corner = 0.5 * (low + high - size * shapes.cell[i])
        cells = [tuple(cell) for cell in np.floor((plan - corner) / shapes.cell[i]).astype(int)]
        occupied = {cell for cell, mine in zip(cells, own, strict=True) if mine}
        place = np.floor(away @ shapes.normal[i] / step).astype(int) + n_slices // 2
        assert n_cells[i] == len(occupied)
        for layer in range(n_slices - 1):
            inside = np.flatnonzero(~own & ((place == layer) | (place == layer + 1)))
            hit = [cells[k] for k in inside if cells[k] in occupied]
            assert count[i, layer] == len(hit)
            assert cover[i, layer] == pytest.approx(len(set(hit)) / len(occupied))
