from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mapq.report.scene import build_scene, evenly, outlines
from tests.mapq.factories import make_patches, sample_patches, wall


def area_of(ring: np.ndarray) -> float:
    return 0.5 * float(np.linalg.norm(np.cross(ring[1:-1] - ring[0], ring[2:] - ring[0]).sum(axis=0)))


def unpack(head: dict, content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Read what pages read, as docs/report.md says."""
    values = np.frombuffer(content, "<i4")
    parts = np.split(values, np.cumsum([3 * head["k"], head["m"] + 2, 3 * head["h"]]))
    places = [part.reshape(3, -1).T * head["step"] + head["low"] for part in (parts[0], parts[2])]
    return places[0], parts[1], places[1], parts[3]


def test_outlines_are_hulls_but_for_blunt_corners():
    patches = sample_patches([wall((0, 0), (8, 1)), wall((20, 3), (20, 9))], seed=1, noise=0.0)
    points, start = patches.members
    xyz = patches.cloud.xyz[points]
    corners, begin = outlines(xyz, start, patches.normal)
    for patch in range(2):
        mine, ring = xyz[start[patch] : start[patch + 1]], corners[begin[patch] : begin[patch + 1]]
        across = np.cross(patches.normal[patch], [0.0, 0.0, 1.0])
        hull = ConvexHull(np.column_stack([mine @ across, mine[:, 2]])).volume
        assert 0.95 * hull < area_of(ring) <= hull * (1 + 1e-9)


def test_a_line_of_points_a_pair_and_a_lost_normal_have_no_outline():
    line = np.outer(np.linspace(0, 1, 9), [1.0, 0.0, 0.0])
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    xyz = np.concatenate([line, square[:2], square, square])
    normal = np.array([[0.0, 0, 1], [0, 0, 1], [np.nan, 0, 0], [0, 0, 1]])
    corners, begin = outlines(xyz, np.array([0, 9, 11, 15, 19]), normal)
    assert (begin[1], begin[2], begin[3], begin[4]) == (0, 0, 0, 4)
    assert area_of(corners) == pytest.approx(1.0)


def test_points_are_ordered_by_patch_and_stored_to_the_millimetre():
    patches = sample_patches([wall((0, 0), (8, 0)), wall((0, 5), (8, 5))], seed=2)
    patches = make_patches(
        [patches.cloud.xyz[patches.patch == 1], patches.cloud.xyz[patches.patch == 0]], patches.normal, 7
    )
    patches.cloud.xyz[3] = np.nan
    scene = build_scene(patches.cloud.xyz, patches.patch, patches.normal, patches.label, 500)
    points, start, corners, corner_start = unpack(*scene.pack())
    np.testing.assert_allclose(points, scene.points, atol=6e-4)
    np.testing.assert_allclose(corners, scene.corners, atol=6e-4)
    np.testing.assert_array_equal(start, scene.start)
    assert corner_start[-1] == len(corners)
    assert np.abs(points[: start[1], 1] - 5.0).max() < 0.2
    assert start[-1] - start[-2] == 7
    assert len(points) <= 500
    assert scene.n_points == len(patches.cloud) - 1


def test_loose_points_get_what_patches_leave():
    rng = np.random.default_rng(0)
    xyz = rng.uniform(0, 10, (4_000, 3))
    patch = np.where(np.arange(4_000) < 100, 0, -1).astype(np.int32)
    scene = build_scene(xyz, patch, np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.uint8), 1_000)
    assert scene.start[1] == 100
    assert 600 < len(scene.points) <= 1_000


def test_a_map_without_patches_and_one_without_points():
    none = np.zeros((0, 3))
    scene = build_scene(np.ones((4, 3)), np.full(4, -1, np.int32), none, np.zeros(0, np.uint8), 100)
    assert (scene.start.tolist(), len(scene.corners)) == ([0, 4], 0)
    empty = build_scene(none, np.zeros(0, np.int32), none, np.zeros(0, np.uint8), 100)
    assert unpack(*empty.pack())[1].tolist() == [0, 0]


def test_the_box_holds_every_patch_and_leaves_out_what_lies_far_off():
    rng = np.random.default_rng(0)
    xyz = np.concatenate([rng.uniform(20, 30, (100, 3)), rng.uniform(0, 10, (4_000, 3)), [[900.0, -900.0, 50.0]]])
    patch = np.where(np.arange(len(xyz)) < 100, 0, -1).astype(np.int32)
    scene = build_scene(xyz, patch, np.array([[0.0, 0.0, 1.0]]), np.zeros(1, np.uint8), 1_000)
    assert (scene.high >= xyz[:100].max(axis=0)).all()
    assert (scene.low < 0.5).all()
    assert (np.abs(np.concatenate([scene.low, scene.high])) <= 30.0).all()


@pytest.mark.parametrize("n_most", [100, 1_000, 5_000])
def test_of_many_nearly_as_many_stay_as_may(n_most):
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(0, 40, 20_000), rng.uniform(0, 30, 20_000), rng.normal(0, 0.02, 20_000)])
    chosen = evenly(xyz, np.zeros(20_000, np.int32), n_most)
    assert 0.6 * n_most <= len(chosen) <= n_most
    assert (np.diff(chosen) > 0).all()


def test_what_is_sparse_keeps_its_points_beside_what_is_dense():
    rng = np.random.default_rng(2)
    dense, sparse = rng.uniform(0, 10, (50_000, 2)), rng.uniform(0, 10, (8_000, 2)) + 20.0
    xyz = np.column_stack([np.concatenate([dense, sparse]), np.zeros(58_000)])
    chosen = evenly(xyz, np.zeros(58_000, np.int32), 2_000)
    assert 0.8 < np.count_nonzero(chosen >= 50_000) / np.count_nonzero(chosen < 50_000) < 1.2


def test_every_group_stays():
    rng = np.random.default_rng(3)
    group = np.repeat(np.arange(300, dtype=np.int32), 40)
    chosen = evenly(rng.uniform(0, 0.1, (12_000, 3)), group, 400)
    assert len(np.unique(group[chosen])) == 300
