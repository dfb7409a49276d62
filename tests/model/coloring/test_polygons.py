"""Coloring to polygons and back; areas by three routes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Point, Polygon, box

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, from_polygons, occupied_polygons, violations
from prf.model.coloring.polygons import turning_corners
from prf.model.window import INTERIOR, Window
from prf.shell.errors import InputError
from tests.reference.slow_coloring import edge_set, read_cf, slab_area

UNIT = Window(0.0, 0.0, 1.0, 1.0)
LARGE = Window(-20.0, 5.0, 20.0, 35.0)


def assert_round_trip(coloring: Coloring) -> MultiPolygon:
    polygons = occupied_polygons(coloring)
    assert polygons.is_valid
    back = from_polygons(polygons, coloring.window)
    assert edge_set(back) == edge_set(coloring)
    assert back.anchor_black == coloring.anchor_black
    return polygons


def test_small_draws_round_trip() -> None:
    for draw in exact_draws(1.0, UNIT, 300, np.random.default_rng(1)):
        polygons = assert_round_trip(draw)
        assert polygons.area == pytest.approx(black_areas(Draws.from_colorings([draw]))[0], abs=1e-12)


def test_areas_agree_with_slabs() -> None:
    for draw in exact_draws(1.0, UNIT, 40, np.random.default_rng(2)):
        assert occupied_polygons(draw).area == pytest.approx(slab_area(draw), abs=1e-12)


def test_large_draws_round_trip() -> None:
    draws = exact_draws(0.3, LARGE, 3, np.random.default_rng(3))
    assert draws.n_edges.min() > 1000
    for draw, area in zip(draws, black_areas(draws), strict=True):
        polygons = assert_round_trip(draw)
        assert polygons.area == pytest.approx(area, rel=1e-9)
        xy = np.random.default_rng(4).uniform(LARGE[:2], LARGE[2:], (5000, 2))
        np.testing.assert_array_equal(shapely.contains_xy(polygons, xy), black_at(draw, xy))


def test_a_graph_of_another_program_round_trips(shared_data: Path) -> None:
    assert_round_trip(read_cf(shared_data / "prf" / "arak" / "test.cf"))


@pytest.mark.parametrize("black", [False, True])
def test_one_colour(black: bool) -> None:
    polygons = assert_round_trip(Coloring.empty(UNIT, black))
    assert polygons.area == float(black)


def test_holes_and_islands_are_kept() -> None:
    ring = Polygon(box(0.1, 0.1, 0.9, 0.9).exterior, [box(0.2, 0.2, 0.8, 0.8).exterior])
    coloring = from_polygons(MultiPolygon([ring, box(0.4, 0.3, 0.6, 0.45)]), UNIT)
    assert (coloring.n_edges, coloring.anchor_black) == (12, False)
    assert occupied_polygons(coloring).equals(MultiPolygon([ring, box(0.4, 0.3, 0.6, 0.45)]))


def test_clipping_leaves_no_edge_along_the_border() -> None:
    coloring = from_polygons(Point(1.0, 0.4).buffer(0.3), UNIT)
    assert violations(coloring) == []
    assert sorted(coloring.side[coloring.side != INTERIOR].tolist()) == [1, 1]
    outline = Polygon([(-1.0, -1.0), (0.7, -1.0), (-0.5, 0.9)])
    cut = from_polygons(outline, UNIT)
    assert violations(cut) == []
    assert occupied_polygons(cut).area == pytest.approx(shapely.intersection(outline, box(*UNIT)).area)


def test_slanted_clips_land_exactly_on_the_sides() -> None:
    rng = np.random.default_rng(5)
    window = Window(-0.1, 0.3, 1.7, 1.9)
    for _ in range(200):
        triangle = Polygon(rng.uniform(-1.0, 3.0, (3, 2)))
        coloring = from_polygons(triangle, window)
        assert violations(coloring) == []
        inside = shapely.intersection(triangle, box(*window)).area
        assert occupied_polygons(coloring).area == pytest.approx(inside, abs=1e-9)


@pytest.mark.parametrize("hair", [1e-12, 1e-10, 9e-10])
def test_slivers_along_the_border_are_dropped(hair: float) -> None:
    beside = [box(1.0 - hair, 0.2, 2.0, 0.4), box(0.1, -1.0, 0.9, hair), box(-1.0, 1.0 - hair, 2.0, 2.0)]
    for region in (*beside, shapely.union_all(beside)):
        nothing = from_polygons(region, UNIT)
        assert (nothing.n_edges, nothing.anchor_black) == (0, False)
    inside = box(0.4, 0.4, 0.5, 0.5)
    assert occupied_polygons(from_polygons(shapely.union_all([inside, *beside]), UNIT)).area == pytest.approx(0.01)
    assert from_polygons(box(hair, hair, 1.0, 1.0 - hair), UNIT).anchor_black


def test_overlapping_parts_are_united() -> None:
    coloring = from_polygons(MultiPolygon([box(0.1, 0.1, 0.5, 0.5), box(0.3, 0.3, 0.7, 0.7)]), UNIT)
    assert occupied_polygons(coloring).area == pytest.approx(0.28)
    assert coloring.n_edges == 8


def test_nothing_and_outside_are_white() -> None:
    for polygons in (MultiPolygon(), box(2.0, 2.0, 3.0, 3.0), box(1.0, 0.0, 2.0, 1.0)):
        coloring = from_polygons(polygons, UNIT)
        assert (coloring.n_edges, coloring.anchor_black) == (0, False)


@pytest.mark.filterwarnings("error")
def test_corners_next_to_zero_are_taken_without_a_warning() -> None:
    assert_round_trip(from_polygons(Polygon([(0.7, 0.65), (0.6, 0.73), (1.7e-308, 0.67), (1.6e-308, 0.21)]), UNIT))


def test_the_anchor_may_lie_on_an_edge() -> None:
    coloring = from_polygons(box(0.25, 0.25, 0.5, 0.75), UNIT)
    assert black_at(coloring, [(0.3, 0.5), (0.7, 0.5)]).tolist() == [True, False]


def test_polygons_that_touch_at_a_point_are_refused() -> None:
    with pytest.raises(InputError, match="invalid coloring"):
        from_polygons(MultiPolygon([box(0.1, 0.1, 0.5, 0.5), box(0.5, 0.5, 0.9, 0.9)]), UNIT)
    with pytest.raises(InputError, match="invalid coloring"):
        from_polygons(Polygon([(0.0, 0.5), (0.5, 0.3), (0.5, 0.7)]), UNIT)


@pytest.mark.parametrize("shift", [0.0, 1e-8, -1e-8])
@pytest.mark.parametrize("corner", range(4))
def test_a_corner_that_is_there_twice_stays_a_corner(corner: int, shift: float) -> None:
    ring = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]])
    along = np.roll(ring, -1, axis=0)[corner] - ring[corner]
    twice = np.insert(ring, corner + 1, ring[corner] + shift * np.abs(along), axis=0)
    for start in range(5):
        kept = turning_corners(np.roll(twice, start, axis=0), 1e-6)
        assert len(kept) == 4
        assert Polygon(kept).area == pytest.approx(80.0, abs=1e-5)


def test_a_curve_of_many_vertices_is_not_cut_to_its_chord() -> None:
    turn = np.linspace(0.0, 0.5 * np.pi, 20_001)
    quarter = np.vstack([[0.0, 0.0], np.column_stack([np.cos(turn), np.sin(turn)])])
    kept = turning_corners(quarter, 1e-6)
    assert len(kept) < 2000
    assert Polygon(kept).area == pytest.approx(0.25 * np.pi, abs=1e-5)


def test_only_vertices_of_straight_runs_are_removed() -> None:
    side = np.arange(1000.0)[:, None]
    zero, end = np.zeros_like(side), np.full_like(side, 1000.0)
    sides = [(side, zero), (end, side), (end - side, end), (zero, end - side)]
    ring = np.vstack([np.hstack(pair) for pair in sides])
    for start in range(3):
        kept = turning_corners(np.roll(ring, start, axis=0), 1e-6)
        assert sorted(kept.tolist()) == [[0.0, 0.0], [0.0, 1000.0], [1000.0, 0.0], [1000.0, 1000.0]]
