"""Pieces of wall that are almost one plane: one patch or two, whatever part of them a tile sees."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import write_cloud
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import sum_regions
from mapq.scale.borders import Shared
from mapq.scale.cut import Cut, Pieces
from mapq.scale.maps import Where, segment_map
from mapq.scale.moments import translate
from mapq.scale.run import ScaleSettings
from mapq.scale.unions import decide_unions
from mapq.segmentation import SegmentSettings, segment

SIGMA = 0.015
MAX_RMS = 0.6 * 3.0 * SIGMA


def front(begin: float, end: float, setback: float, density: float = 40.0) -> np.ndarray:
    """Points on a house front of 8 m height along x."""
    rng = np.random.default_rng([int(100 * begin), 3])
    n = int(density * (end - begin) * 8.0)
    place = np.column_stack([rng.uniform(begin, end, n), np.full(n, setback), rng.uniform(0.0, 8.0, n)])
    return place + rng.normal(0.0, SIGMA, place.shape)


def pieces_of(parts: list[np.ndarray], own_below: float, own_from: float, parent: list[int]) -> Cut:
    """What a tile tells of regions of which it sees some points, and owns those of its own stretch of x."""
    xyz = np.concatenate(parts)
    region = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    is_own = (xyz[:, 0] < own_below) & (xyz[:, 0] >= own_from)
    origin, own = np.zeros((len(parts), 3)), np.empty((len(parts), MOMENTS))
    sum_regions(xyz, np.where(is_own, region, np.int32(-1)), origin, own)
    begin, seen = np.zeros((len(parts), 3)), np.empty((len(parts), MOMENTS))
    sum_regions(xyz, region, begin, seen)
    pairs = np.array([[k, k + 1] for k in range(len(parts) - 1)], np.int32).reshape(-1, 2)
    pieces = Pieces(origin, own, translate(seen, begin, origin), pairs, np.array(parent, np.int32))
    nothing = np.zeros(0, np.int64)
    return Cut(0, *(np.zeros((0, 3)),) * 3, *(nothing,) * 5, nothing, nothing, pieces, 0, 0)  # type: ignore[arg-type]


def two_houses(offset: float, parent: list[int]) -> tuple[list[Cut], Shared]:
    """Houses from 0 to 20 and 20 to 40 m; the tiles meet at 24 m, and each sees 4 m beyond."""
    left, right = front(0.0, 20.0, 0.0), front(20.0, 40.0, offset)
    first = pieces_of([left, right[right[:, 0] < 28.0]], 24.0, -1.0, parent)
    second = pieces_of([right], 99.0, 24.0, [0])
    n = int(((right[:, 0] > 20.0) & (right[:, 0] < 28.0)).sum())
    return [first, second], Shared(np.array([[0, 1]]), np.array([[1, 0]]), *(np.array([n]),) * 3)


@pytest.mark.parametrize(("offset", "is_one"), [(0.06, True), (0.3, False)])
@pytest.mark.parametrize("parent", [[0, 0], [0, 1]])
def test_whole_houses_decide_whatever_a_tile_said(offset, is_one, parent):
    cuts, shared = two_houses(offset, parent)
    found = decide_unions(cuts, shared, MAX_RMS)
    assert bool(found.label[0][0] == found.label[0][1]) is is_one
    assert found.label[0][1] == found.label[1][0]
    had_it_so = (parent == [0, 0]) is is_one
    assert (found.decided[0] is None) is had_it_so
    if found.decided[0] is not None:
        assert found.decided[0].parent.tolist() == ([0, 0] if is_one else [0, 1])
    assert found.decided[1] is None


def test_a_tile_alone_has_the_last_word():
    cut = pieces_of([front(0.0, 9.0, 0.0), front(9.0, 20.0, 0.3)], 99.0, -9.0, [0, 1])
    nothing = Shared(*(np.zeros((0, 2), np.int64),) * 2, *(np.zeros(0, np.int64),) * 3)
    assert decide_unions([cut], nothing, MAX_RMS).decided == [None]


def test_a_row_of_houses_almost_in_one_line_is_cut_alike_in_any_tiles(tmp_path):
    """Setbacks at random, most of them within what noise hides."""
    rng = np.random.default_rng(27)
    cuts = np.cumsum(rng.uniform(5.0, 25.0, 14))
    fronts = [front(a, b, rng.uniform(0.0, 0.12)) for a, b in pairwise(cuts)]
    cloud = PointCloud.from_world(np.concatenate(fronts))
    path = str(tmp_path / "row.ply")
    write_cloud(path, cloud)
    plain = segment(cloud, SegmentSettings())
    found = segment_map(path, str(tmp_path / "x"), ScaleSettings(tile_points=10_000), Where())
    assert len(cloud) > 50_000
    n_plain, n_found = plain.counts, found.counts
    shared = np.zeros((len(n_plain), len(n_found)))
    both = (plain.patch >= 0) & (found.patch >= 0)
    np.add.at(shared, (plain.patch[both], found.patch[both]), 1)
    iou = (shared / (n_plain[:, None] + n_found - shared)).max(axis=1)
    assert iou @ n_plain / n_plain.sum() > 0.99
