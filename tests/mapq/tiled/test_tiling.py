"""Tiles are the whole map, of about one size, and see what lies around them; regions are united across borders."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.axes import keys_of, turn
from mapq.cloud import PointCloud
from mapq.configuration import SegmentSettings
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import sum_regions
from mapq.segmentation import Regions, join_regions
from mapq.segmentation.parameters import choose_parameters
from mapq.segmentation.points import sort_points
from mapq.tiled import tiling as module
from mapq.tiled.cut import shared_pairs
from mapq.tiled.tiling import Counts, make_tiling


@pytest.fixture(scope="module")
def xyz() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.concatenate([rng.normal(0.0, 5.0, (9000, 3)), rng.uniform(-60.0, 90.0, (9000, 3))])


@pytest.mark.parametrize("n_tiles", [1, 2, 3, 7, 16])
def test_every_point_has_one_tile_that_holds_it(xyz, n_tiles):
    tiling = make_tiling(Counts().plus(xyz), -(-len(xyz) // n_tiles))
    tile = tiling.of_points(xyz)
    sizes = np.bincount(tile, minlength=n_tiles)
    assert len(tiling.boxes) == n_tiles
    assert sizes.sum() == len(xyz)
    assert sizes.max() < 1.2 * len(xyz) / n_tiles
    inside = np.array([tiling.near(xyz, number, 0.0) for number in range(n_tiles)])
    np.testing.assert_array_equal(inside.sum(axis=0), 1)
    np.testing.assert_array_equal(inside.argmax(axis=0), tile)


def test_neighbours_are_those_whose_halos_meet(xyz):
    tiling = make_tiling(Counts().plus(xyz), len(xyz) // 8)
    boxes = tiling.boxes
    for tile in range(len(boxes)):
        gap = np.maximum(boxes[:, :2] - boxes[tile, 2:], boxes[tile, :2] - boxes[:, 2:]).max(axis=1)
        near = set(np.flatnonzero(gap <= 6.0).tolist()) - {tile}
        assert near == set(tiling.neighbours(tile, 3.0).tolist())


def test_points_far_off_stretch_no_tile(xyz):
    far = np.concatenate([xyz, [[-5e6, 4e6, 0.0], [-5e6, 4e6, 1.0]]])
    sizes = np.bincount(make_tiling(Counts().plus(far), len(far) // 8 + 1).of_points(far), minlength=8)
    assert len(sizes) == 8
    assert sizes.max() < 1.2 * len(far) / 8


def test_counts_are_those_of_coarser_cells_where_there_are_too_many(xyz, monkeypatch):
    monkeypatch.setattr(module, "MOST_CELLS", 500)
    found = Counts()
    for piece in np.array_split(xyz, 4):
        found = found.plus(piece)
    assert len(found.cells) <= 500
    whole = Counts(found.side, np.zeros((0, 2), np.int64), np.zeros(0, np.int64))
    monkeypatch.undo()
    whole = whole.plus(xyz)
    np.testing.assert_array_equal(found.cells, whole.cells)
    np.testing.assert_array_equal(found.counts, whole.counts)
    for quarter in (1, 2, 3):
        turned = Counts(found.side).plus(turn(xyz, quarter))
        assert set(keys_of(found.turned(quarter).cells)) == set(keys_of(turned.cells))


def wall(x: float, offset: float = 0.0, n: int = 300) -> np.ndarray:
    rng = np.random.default_rng(int(x) + 17)
    return np.column_stack([rng.uniform(x, x + 10.0, n), rng.normal(offset, 0.01, n), rng.uniform(0.0, 5.0, n)])


def joined(pieces: list[np.ndarray], pairs: list[tuple[int, int]]) -> list[int]:
    """Return the patch of each piece, one a tile."""
    points = sort_points(PointCloud(np.concatenate(pieces), np.zeros(3)))
    chosen = choose_parameters(points, SegmentSettings(noise=0.01), 0)
    tiles = []
    for place, piece in enumerate(pieces):
        origin, sums = np.zeros((1, 3)), np.empty((1, MOMENTS))
        sum_regions(piece, np.zeros(len(piece), np.int32), origin, sums)
        counts = np.array([len(piece)]), np.array([place], np.uint64), np.ones(1)
        tiles.append(Regions(origin, sums, *counts, np.zeros((1, 10))))
    found = join_regions(tiles, np.array(pairs, np.int64).reshape(-1, 2), chosen)
    together = np.concatenate(pieces)
    np.testing.assert_allclose(found.n_points.sum(), len(together))
    return [int(number[0]) for number in found.number]


def test_a_chain_of_pieces_is_one_patch_whatever_the_order_of_pairs():
    pieces = [wall(10.0 * number) for number in range(4)]
    for pairs in ([(0, 1), (1, 2), (2, 3)], [(2, 3), (0, 1), (1, 2)]):
        assert joined(pieces, pairs) == [0, 0, 0, 0]
    assert sorted(joined(pieces, [])) == [0, 1, 2, 3]


def test_pieces_in_different_planes_are_not_united():
    assert sorted(joined([wall(0.0), wall(10.0, 0.3)], [(0, 1)])) == [0, 1]


@pytest.mark.parametrize(("n_shared", "meet"), [(26, True), (24, False), (2, False)])
def test_regions_meet_that_share_a_fair_part_of_what_both_tiles_see(n_shared, meet):
    number = np.arange(100, 500)
    mine, theirs = (np.column_stack([number, np.full(400, -1)]) for _ in range(2))
    mine[:50, 1] = 3
    theirs[50 - n_shared :, 1] = 5
    assert shared_pairs(mine[:390], theirs).tolist() == ([[3, 5]] if meet else [])
