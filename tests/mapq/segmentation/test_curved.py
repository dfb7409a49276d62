"""Columns come out as one patch each; walls, corners, crowns of trees and clutter do not."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.axes import turn, turn_cloud
from mapq.cloud import PointCloud
from mapq.configuration import SURFACES
from mapq.segmentation import segment
from tests.mapq.columns import COLUMNS, CURVED, column, scanned
from tests.reference.mapq_segment import wall

IS_CURVED = SURFACES.index("curved")


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def room() -> PointCloud:
    return scanned()


def test_each_column_is_one_patch_of_its_radius_about_its_axis(room) -> None:
    patches = segment(room, CURVED)
    (curved,) = np.nonzero(patches.kinds == IS_CURVED)
    assert len(curved) == len(COLUMNS)
    for x, y, radius in COLUMNS:
        on = np.abs(np.hypot(room.xyz[:, 0] - x, room.xyz[:, 1] - y) - radius) < 0.03
        on &= (room.xyz[:, 2] > 0.05) & (np.hypot(room.xyz[:, 0] - x, room.xyz[:, 1] - y) < 1.5)
        patch, counts = np.unique(patches.patch[on], return_counts=True)
        mine = int(patch[counts.argmax()])
        assert mine in curved
        assert counts.max() > 0.95 * on.sum()
        bend = np.linalg.norm(patches.bend[mine])
        assert 1.0 / bend == pytest.approx(radius, rel=0.02)
        assert abs(patches.bend[mine, 2]) / bend > 0.9999
        axis = patches.centroid[mine] - patches.normal[mine] / bend
        assert axis[:2] == pytest.approx([x, y], abs=0.01)
        assert patches.normal[mine] @ patches.bend[mine] == pytest.approx(0.0, abs=1e-12)


def test_without_round_things_patches_are_those_of_planes_alone() -> None:
    room = scanned(columns=())
    crown = rng(1).normal(0.0, 1.0, (3000, 3))
    crown *= rng(2).uniform(0.0, 1.0, (3000, 1)) ** (1 / 3) / np.linalg.norm(crown, axis=1, keepdims=True)
    strays = rng(3).uniform(0.0, 3.0, (300, 3))
    bay = [wall(rng(seed), 3.0, 3.0, degrees=45.0 * seed, start=20.0 + 2.0 * seed) for seed in range(3)]
    cloud = PointCloud.from_world(np.vstack([room.xyz, crown + np.array((4.0, 4.0, 1.5)), strays, *bay]))
    one, other = segment(cloud), segment(cloud, CURVED)
    np.testing.assert_array_equal(one.patch, other.patch)
    np.testing.assert_array_equal(one.normal, other.normal)
    assert not other.bend.any()


@pytest.mark.parametrize("shift", [0.2, 0.3])
def test_both_copies_of_a_column_are_found(shift) -> None:
    x, y, radius = COLUMNS[2]
    copies = column(rng(1), (x, y, radius), 6000), column(rng(2), (x + shift, y, radius), 6000)
    patches = segment(PointCloud.from_world(np.vstack([*copies, wall(rng(3), spacing=0.05, noise=0.01)])), CURVED)
    curved = np.flatnonzero(patches.kinds == IS_CURVED)
    axes = patches.centroid[curved] - patches.normal[curved] / np.linalg.norm(patches.bend[curved], axis=1)[:, None]
    assert axes[:, 0].min() == pytest.approx(x, abs=0.03)
    assert axes[:, 0].max() == pytest.approx(x + shift, abs=0.03)


@pytest.mark.parametrize("inside", [False, True])
def test_a_lying_pipe_and_a_vault_are_curved_too(inside) -> None:
    radius = 3.0 if inside else 0.2
    pipe = column(rng(1), (0.0, 0.0, radius), int(5000 * radius), 0.0, 0.7 if inside else 1.4)[:, [2, 1, 0]]
    beside = wall(rng(2), spacing=0.05, noise=0.01) + np.array((0.0, 9.0, 0.0))
    patches = segment(PointCloud.from_world(np.vstack([pipe, beside])), CURVED)
    curved = np.flatnonzero(patches.kinds == IS_CURVED)
    assert len(curved) == 1
    assert np.linalg.norm(patches.bend[curved[0]]) == pytest.approx(1.0 / radius, rel=0.05)
    assert abs(patches.bend[curved[0], 0]) * radius > 0.99


def test_neither_order_nor_quarter_turns_matter(room) -> None:
    first = segment(room, CURVED)
    order = rng(1).permutation(len(room))
    again = segment(room.take(order), CURVED)
    np.testing.assert_array_equal(again.patch, first.patch[order])
    for name in ("normal", "centroid", "bend"):
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    for quarter in (1, 2, 3):
        turned = segment(turn_cloud(room, quarter), CURVED)
        np.testing.assert_array_equal(turned.patch, first.patch)
        np.testing.assert_array_equal(turned.bend, turn(first.bend, quarter))
        assert turned.report == first.report
