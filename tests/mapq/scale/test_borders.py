"""Regions of several tiles become one patch where they share points and lie in one plane."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import sum_regions
from mapq.scale.borders import BorderTask, Shared, compare_borders, unite_regions
from mapq.scale.files import save_arrays
from mapq.scale.moments import translate
from mapq.scale.tile_files import border_path


def moments(pieces: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    xyz = np.concatenate(pieces)
    region = np.repeat(np.arange(len(pieces), dtype=np.int32), [len(piece) for piece in pieces])
    origin, sums = np.zeros((len(pieces), 3)), np.empty((len(pieces), MOMENTS))
    sum_regions(xyz, region, origin, sums)
    return origin, sums


def wall(x: float, offset: float = 0.0, n: int = 300, length: float = 10.0) -> np.ndarray:
    rng = np.random.default_rng(int(x) + 17)
    return np.column_stack([rng.uniform(x, x + length, n), rng.normal(offset, 0.01, n), rng.uniform(0.0, 5.0, n)])


def shared(pairs: list[tuple[int, int]], n: list[tuple[int, int, int]]) -> Shared:
    """Pairs of regions of which each is in a tile of its own."""
    one, other = np.array(pairs, np.int64).reshape(-1, 2).T
    counts = np.array(n, np.int64).reshape(-1, 3)
    return Shared(np.column_stack([one, one]), np.column_stack([other, other]), *counts.T)


def united(pieces: list[np.ndarray], pairs: list[tuple[int, int]], n: list[tuple[int, int, int]]) -> list[int]:
    origin, sums = moments(pieces)
    everyone = np.ones(len(pieces), bool)
    places = np.array(pairs, np.int64).reshape(-1, 2)
    return unite_regions(origin, sums, everyone, places, shared(pairs, n), 0.03).tolist()


def test_a_chain_of_pieces_is_one_patch_whatever_the_order_of_pairs():
    pieces = [wall(10.0 * number) for number in range(4)]
    for pairs in ([(0, 1), (1, 2), (2, 3)], [(2, 3), (0, 1), (1, 2)]):
        assert united(pieces, pairs, [(40, 50, 50)] * 3) == [0, 0, 0, 0]


def test_pieces_in_different_planes_stay_apart():
    assert united([wall(0.0), wall(10.0, 0.3)], [(0, 1)], [(50, 50, 50)]) == [0, 1]


@pytest.mark.parametrize(("n", "is_one"), [((26, 50, 400), True), ((24, 50, 400), False), ((2, 2, 2), False)])
def test_a_fair_share_of_what_both_see_of_the_smaller_one_is_asked(n, is_one):
    assert (united([wall(0.0), wall(10.0)], [(0, 1)], [n]) == [0, 0]) is is_one


def test_what_only_a_halo_shows_bridges_nothing():
    origin, sums = moments([wall(0.0), wall(5.0, n=400), wall(10.0)])
    pairs, has_own = [(0, 1), (1, 2)], np.array([True, False, True])
    counts = shared(pairs, [(60, 100, 90), (85, 90, 99)])
    found = unite_regions(origin, sums, has_own, np.array(pairs), counts, 0.03)
    assert found.tolist() == [0, 2, 2]


def test_a_region_over_two_walls_is_that_of_which_it_has_more():
    """Tile 0 has both walls apart, tile 1 one region over them."""
    origin, sums = moments([wall(0.0), wall(10.0), wall(5.0, n=400)])
    one, other = np.array([[0, 0], [0, 1]]), np.array([[1, 2], [1, 2]])
    counts = Shared(one, other, *np.array([(60, 70, 200), (120, 130, 200)]).T)
    pairs = np.array([[0, 2], [1, 2]])
    for label, expected in ((None, [0, 1, 1]), (np.array([5, 5, 5]), [0, 0, 0])):
        assert unite_regions(origin, sums, np.ones(3, bool), pairs, counts, 0.03, label).tolist() == expected


def test_nothing_shared_unites_nothing():
    assert united([wall(0.0), wall(10.0)], [], []) == [0, 1]


def test_moments_about_another_origin_are_those_of_the_points():
    piece = wall(3.0)
    origin, sums = moments([piece])
    other = np.array([[100.0, -20.0, 7.0]])
    moved = translate(sums, origin, other)
    away = piece - other
    expected = [len(piece), *away.sum(axis=0)]
    expected += [(away[:, a] * away[:, b]).sum() for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    np.testing.assert_allclose(moved[0], expected, rtol=1e-9)


def test_borders_are_compared_point_by_point(tmp_path):
    first = {"number": np.arange(0, 100), "region": np.repeat([0, 1, -1, 2], 25).astype(np.int32)}
    second = {"number": np.arange(20, 120), "region": np.repeat([5, -1], 50).astype(np.int32)}
    save_arrays(border_path(str(tmp_path), 3), **first)
    save_arrays(border_path(str(tmp_path), 4), **second)
    found = compare_borders(BorderTask(3, (4,), str(tmp_path)))
    assert found.one.tolist() == [[3, 0], [3, 1]]
    assert found.other.tolist() == [[4, 5], [4, 5]]
    assert found.n_shared.tolist() == [5, 25]
    assert found.n_one.tolist() == [5, 25]
    assert found.n_other.tolist() == [50, 50]
    assert len(compare_borders(BorderTask(3, (), str(tmp_path))).one) == 0
