"""Predicates of the plane against shapely, and where they meet each other."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from prf.kernels.state.grid import make_grid
from prf.kernels.state.sites import Sites
from prf.model.layout import make_sites
from prf.model.window import Window
from tests.kernels.entries import (
    box_table,
    distance_table,
    encloses_site,
    hit_table,
    inside_table,
    meet_table,
    sines,
    turn_sites,
)

small = st.integers(-6, 6)
segment = st.tuples(small, small, small, small).filter(lambda s: s[:2] != s[2:])


def meets(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    found = np.zeros(len(one), np.bool_)
    meet_table(np.ascontiguousarray(one, np.float64), np.ascontiguousarray(two, np.float64), found)
    return found


def test_segments_meet_where_shapely_says() -> None:
    rng = np.random.default_rng(16)
    one, two = rng.uniform(-1, 1, (2, 5000, 4))
    expected = shapely.intersects(
        shapely.linestrings(one.reshape(-1, 2, 2)), shapely.linestrings(two.reshape(-1, 2, 2))
    )
    assert np.array_equal(meets(one, two), expected)
    assert 500 < expected.sum() < 4500


def lines(ends: np.ndarray) -> np.ndarray:
    return np.asarray(shapely.linestrings(ends.reshape(-1, 2, 2)))


def test_segments_are_as_far_apart_as_shapely_says() -> None:
    """Of places alone too, which are segments without length."""
    rng = np.random.default_rng(19)
    one, two = rng.uniform(-1, 1, (2, 5000, 4))
    one[:500, 2:], two[250:750, 2:] = one[:500, :2], two[250:750, :2]
    found = np.zeros(5000)
    distance_table(one, two, found)
    np.testing.assert_allclose(np.sqrt(found), shapely.distance(lines(one), lines(two)), atol=1e-12)
    assert 400 < (found == 0.0).sum() < 4000


def test_segments_meet_boxes_where_shapely_says() -> None:
    rng = np.random.default_rng(20)
    segments, corners = rng.uniform(-1, 1, (2, 5000, 4))
    boxes = np.hstack([np.minimum(corners[:, :2], corners[:, 2:]), np.maximum(corners[:, :2], corners[:, 2:])])
    met = np.zeros(5000, np.bool_)
    box_table(segments, boxes, met)
    assert np.array_equal(met, shapely.intersects(lines(segments), shapely.box(*boxes.T)))
    assert 500 < met.sum() < 4500


@given(segment, segment.filter(lambda s: s[0] < s[2] and s[1] < s[3]))
def test_touching_a_box_counts_as_meeting_it(p: tuple[int, ...], box: tuple[int, ...]) -> None:
    met = np.zeros(2, np.bool_)
    box_table(np.array([p, p[2:] + p[:2]], np.float64), np.array([box, box], np.float64), met)
    expected = shapely.LineString([p[:2], p[2:]]).intersects(shapely.box(*box))
    assert met.tolist() == [expected, expected]


@given(segment, segment)
def test_touching_counts_as_meeting(p: tuple[int, ...], q: tuple[int, ...]) -> None:
    """Whole coordinates: every sort of contact, end on end, end on the middle, one on the other."""
    expected = shapely.LineString([p[:2], p[2:]]).intersects(shapely.LineString([q[:2], q[2:]]))
    for a in (p, p[2:] + p[:2]):
        for b in (q, q[2:] + q[:2]):
            assert meets(np.array([a]), np.array([b]))[0] == expected
            assert meets(np.array([b]), np.array([a]))[0] == expected


def test_rays_hit_where_shapely_says() -> None:
    rng = np.random.default_rng(17)
    angle = rng.uniform(-4, 4, 300)
    rays = np.hstack([rng.uniform(-1, 1, (300, 2)), np.cos(angle)[:, None], np.sin(angle)[:, None]])
    segments = rng.uniform(-1, 1, (40, 4))
    found = np.empty((300, 40))
    hit_table(rays, segments, found)
    lines = shapely.linestrings(np.stack([rays[:, :2], rays[:, :2] + 10.0 * rays[:, 2:]], axis=1))
    met = shapely.intersection(lines[:, None], shapely.linestrings(segments.reshape(-1, 2, 2))[None, :])
    hit = ~shapely.is_empty(met)
    assert np.array_equal(np.isfinite(found), hit)
    ray, _ = np.nonzero(hit)
    assert found[hit] == pytest.approx(np.hypot(*(shapely.get_coordinates(met[hit]) - rays[ray, :2]).T), abs=1e-9)


def test_what_lies_behind_a_ray_is_not_hit() -> None:
    found = np.empty((1, 3))
    hit_table(np.array([[0.0, 0.0, 1.0, 0.0]]), np.array([[-1, -1, -1, 1], [0, -1, 0, 1], [2, -1, 2, 1]], float), found)
    assert found.tolist() == [[np.inf, np.inf, 2.0]]


@pytest.mark.parametrize("n", [3, 4, 7])
def test_points_lie_inside_a_loop_by_parity(n: int) -> None:
    """Also loops that cross themselves, as those of moved vertices may: the sum of shapely's crossings decides."""
    rng = np.random.default_rng(18)
    for _ in range(20):
        loop = rng.uniform(-1, 1, (n, 2))
        xy = rng.uniform(-1, 1, (400, 2))
        found = np.zeros(400, np.bool_)
        inside_table(xy, loop, found)
        ring = shapely.linestrings(np.stack([loop, np.roll(loop, -1, axis=0)], axis=1))
        out = shapely.linestrings(np.stack([xy, np.broadcast_to([7.0, 3.0], (400, 2))], axis=1))
        assert np.array_equal(found, shapely.intersects(out[:, None], ring[None, :]).sum(axis=1) % 2 == 1)


def test_a_point_belongs_to_exactly_one_of_two_triangles_side_by_side() -> None:
    """Half open: recolouring both recolours every point of the two once, those on the common side too."""
    y, x = np.mgrid[0:9, 0:9] / 8.0
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    found = np.zeros((3, 81), np.bool_)
    for k, loop in enumerate((corners[[0, 1, 2]], corners[[0, 2, 3]], corners)):
        inside_table(xy, np.ascontiguousarray(loop), found[k])
    assert np.array_equal(found[0] ^ found[1], found[2])


def test_sines_are_those_of_angles() -> None:
    rng = np.random.default_rng(19)
    first, turn = rng.uniform(-4, 4, (2, 500))
    length = 10.0 ** rng.uniform(-3, 2, (500, 2))
    v = rng.uniform(-5, 5, (500, 2))
    a = v + length[:, :1] * np.stack([np.cos(first), np.sin(first)], axis=1)
    b = v + length[:, 1:] * np.stack([np.cos(first + turn), np.sin(first + turn)], axis=1)
    found = np.empty(500)
    sines(np.hstack([v, a, b]), found)
    assert found == pytest.approx(np.abs(np.sin(turn)), abs=1e-10)


@pytest.fixture
def sites() -> Sites:
    rng = np.random.default_rng(20)
    window = Window(-5.0, -5.0, 5.0, 5.0)
    xy = np.repeat(rng.uniform(-5, 5, (60, 2)), 3, axis=0)
    return make_sites(make_grid(*window, 0.8), xy)


def test_sites_are_distinct_and_sorted_by_cell(sites: Sites) -> None:
    assert len(sites.xy) == 60 == sites.cell_start[-1]
    ix = ((sites.xy - [sites.grid.x0, sites.grid.y0]) / sites.grid.cell).astype(int)
    cells = ix[:, 0] + sites.grid.nx * ix[:, 1]
    for cell in range(sites.grid.nx * sites.grid.ny):
        assert (cells[sites.cell_start[cell] : sites.cell_start[cell + 1]] == cell).all()


def test_a_loop_encloses_the_sites_of_the_exhaustive_test(sites: Sites) -> None:
    rng = np.random.default_rng(21)
    answers = []
    for _ in range(500):
        centre = rng.uniform(-5, 5, 2)
        loop = np.clip(centre + rng.normal(size=(rng.integers(3, 7), 2)) * 10.0 ** rng.uniform(-1.5, 0.5), -5, 5)
        found = np.zeros(len(sites.xy), np.bool_)
        inside_table(sites.xy, loop, found)
        assert encloses_site(sites, loop) == found.any()
        answers.append(found.any())
    assert 0.1 < np.mean(answers) < 0.9


def test_sites_turn_inside_a_loop_and_nowhere_else(sites: Sites) -> None:
    rng = np.random.default_rng(22)
    black = np.zeros(len(sites.xy), np.bool_)
    for _ in range(200):
        loop = np.clip(rng.uniform(-5, 5, 2) + rng.normal(size=(rng.integers(3, 7), 2)), -5, 5)
        found = np.zeros(len(sites.xy), np.bool_)
        inside_table(sites.xy, loop, found)
        expected = int((black ^ found).sum() - black.sum())
        assert turn_sites(sites, loop, False) == expected
        assert np.array_equal(sites.black, black)
        assert turn_sites(sites, loop, True) == expected
        black ^= found
        assert np.array_equal(sites.black, black)
    assert 0.1 < black.mean() < 0.9
