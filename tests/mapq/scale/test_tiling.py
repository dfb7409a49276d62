"""Tiles: they are the whole map, of about one size, and see what lies around them."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.axes import GroundPlan, turn
from mapq.scale.scan import EstimateTask, estimate, is_drawn, join_counts
from mapq.scale.tiling import cells_of, make_tiling
from mapq.segmentation import SegmentSettings
from prf.shell.errors import InputError
from tests.mapq.factories import wall


def counted(xyz: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    places = cells_of(xyz, cell)
    return join_counts([places], [np.ones(len(places), np.int64)])


@pytest.fixture(scope="module")
def xyz() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.concatenate([rng.normal(0.0, 5.0, (9000, 3)), rng.uniform(-60.0, 90.0, (9000, 3))])


@pytest.mark.parametrize("n_tiles", [1, 2, 3, 7, 16])
def test_every_point_has_one_tile_that_holds_it(xyz, n_tiles):
    tiling = make_tiling(*counted(xyz, 0.5), 0.5, -(-len(xyz) // n_tiles), 3.0)
    assert len(tiling.boxes) == n_tiles
    tile = tiling.of_points(xyz)
    sizes = np.bincount(tile, minlength=n_tiles)
    assert sizes.sum() == len(xyz)
    assert sizes.max() < 1.2 * len(xyz) / n_tiles
    boxes = tiling.boxes[tile]
    assert ((xyz[:, :2] >= boxes[:, :2]) & (xyz[:, :2] < boxes[:, 2:])).all()


def test_neighbours_are_those_whose_halos_meet(xyz):
    tiling = make_tiling(*counted(xyz, 0.5), 0.5, len(xyz) // 8, 3.0)
    boxes = tiling.boxes
    for tile in range(len(boxes)):
        gap = np.maximum(boxes[:, :2] - boxes[tile, 2:], boxes[tile, :2] - boxes[:, 2:]).max(axis=1)
        near = set(np.flatnonzero(gap <= 6.0).tolist()) - {tile}
        assert near == set(tiling.neighbours(tile).tolist())


def test_a_map_of_one_cell_is_one_tile():
    tiling = make_tiling(np.array([[4, -7]]), np.array([1000]), 1.0, 10, 2.0)
    assert len(tiling.boxes) == 1
    assert tiling.of_points(np.array([[1e6, -1e6, 0.0]])).tolist() == [0]


def test_stray_points_far_off_stretch_no_tile(xyz):
    far = np.concatenate([xyz, [[-5e6, 4e6, 0.0], [-5e6, 4e6, 1.0]]])
    tiling = make_tiling(*counted(far, 0.5), 0.5, len(far) // 8 + 1, 3.0)
    sizes = np.bincount(tiling.of_points(far), minlength=8)
    assert len(sizes) == 8
    assert sizes.max() < 1.2 * len(far) / 8


def estimated(tmp_path, xyz):
    sample = str(tmp_path / "sample.npz")
    np.savez(sample, xyz=xyz)
    return estimate(EstimateTask((sample,), SegmentSettings(), GroundPlan.of(xyz), "town"))


def test_many_points_at_one_place_do_not_hide_the_others(tmp_path):
    """As a file may begin with the points (0, 0, 0) of all rays without a return."""
    plain = wall((2.0, 3.0), (12.0, 3.0)).sample(np.random.default_rng(1), 100.0, 0.01)
    found = estimated(tmp_path, np.concatenate([np.zeros((1500, 3)), plain]))
    assert found.chosen.spacing == pytest.approx(0.1, rel=0.1)
    with pytest.raises(InputError, match="town: 2 distinct points in the sample of the map; a plane needs 3"):
        estimated(tmp_path, np.repeat(np.eye(3)[:2], 700, axis=0))


def test_columns_are_drawn_by_their_place_alone():
    columns = np.stack(np.meshgrid(np.arange(-200, 200), np.arange(-200, 200)), axis=-1).reshape(-1, 2)
    drawn = is_drawn(columns, 0.1)
    assert abs(drawn.mean() - 0.1) < 0.005
    order = np.random.default_rng(2).permutation(len(columns))
    np.testing.assert_array_equal(is_drawn(columns[order], 0.1), drawn[order])
    assert is_drawn(columns, 1.0).all()


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_cells_and_columns_of_a_turned_map_are_turned(xyz, quarter):
    places = np.concatenate([xyz, np.rint(xyz), np.rint(xyz / 0.25) * 0.25])
    cells = cells_of(places, 0.5)
    np.testing.assert_array_equal(cells_of(turn(places, quarter), 0.5), turn(cells, quarter))
    drawn = is_drawn(cells, 0.3)
    assert 0.2 < drawn.mean() < 0.4
    np.testing.assert_array_equal(is_drawn(turn(cells, quarter), 0.3), drawn)
