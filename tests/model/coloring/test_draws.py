from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Point, Polygon, box

from prf.model.arak import exact_draws
from prf.model.coloring import (
    Coloring,
    Draws,
    black_areas,
    black_at,
    feature_lines,
    from_feature,
    from_polygons,
    occupied_polygons,
    read_geojsonl,
    to_feature,
    violations,
)
from prf.model.coloring.polygons import turning_corners
from prf.model.window import INTERIOR, Window
from prf.shell.errors import InputError
from tests.factories import write_draws
from tests.reference.slow_coloring import edge_set, read_cf, slab_area

UNIT = Window(0.0, 0.0, 1.0, 1.0)
FIELDS = ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black")


def assert_same(a: Draws, b: Draws) -> None:
    assert a.window == b.window
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype


@pytest.fixture(scope="module")
def draws() -> Draws:
    return exact_draws(0.7, UNIT, 30, np.random.default_rng(1))


def test_colorings_out_and_in_again(draws: Draws) -> None:
    assert len(draws) == 30
    assert_same(Draws.from_colorings(list(draws)), draws)
    assert draws.n_edges.tolist() == [draw.n_edges for draw in draws]
    np.testing.assert_allclose(draws.total_length(), [draw.total_length() for draw in draws])


def test_no_draws_need_a_window() -> None:
    assert len(Draws.from_colorings([], UNIT)) == 0
    assert Draws.from_colorings([], UNIT).total_length().tolist() == []
    with pytest.raises(ValueError, match="one window"):
        Draws.from_colorings([])


def test_owners_and_global_edges(draws: Draws) -> None:
    ends = draws.xy[draws.global_edges()].reshape(-1, 4)
    np.testing.assert_array_equal(ends, np.concatenate([draw.segments() for draw in draws]))
    assert np.bincount(draws.draw_of_edge(), minlength=30).tolist() == draws.n_edges.tolist()


# DRAWS files: exact round trips, files of other programs, unreadable lines.


ODD = Window(-0.1, 1.0 / 3.0, 2.7, 1.9)


@pytest.mark.parametrize("window", [UNIT, ODD])
def test_round_trip_keeps_every_bit(window: Window, tmp_path: Path) -> None:
    draws = exact_draws(1.0, window, 200, np.random.default_rng(1))
    write_draws(tmp_path / "draws.geojsonl", draws)
    back = read_geojsonl(tmp_path / "draws.geojsonl")
    assert back.window == window
    np.testing.assert_array_equal(back.anchor_black, draws.anchor_black)
    for a, b in zip(draws, back, strict=True):
        np.testing.assert_array_equal(a.segments(), b.segments())
        assert a.n_vertices == b.n_vertices
        assert violations(b) == []


def test_the_form_is_that_of_the_contract() -> None:
    draw = next(draw for draw in exact_draws(1.0, UNIT, 50, np.random.default_rng(2)) if draw.n_edges > 5)
    (line,) = feature_lines(Draws.from_colorings([draw]))
    feature = json.loads(line)
    assert feature == to_feature(draw)
    assert feature["type"] == "Feature"
    assert feature["geometry"]["type"] == "MultiLineString"
    assert np.array(feature["geometry"]["coordinates"]).shape == (draw.n_edges, 2, 2)
    assert feature["properties"] == {"anchor_black": draw.anchor_black, "window": [0.0, 0.0, 1.0, 1.0]}
    assert "\n" not in line


def test_no_edge_is_an_empty_list() -> None:
    feature = to_feature(Coloring.empty(UNIT, True))
    assert feature["geometry"]["coordinates"] == []
    assert from_feature(feature).anchor_black is True


def spoilt(**changes: Any) -> str:
    feature = to_feature(Coloring.empty(UNIT))
    for place, value in changes.items():
        part, _, key = place.partition("_")
        if key:
            feature[part][key] = value
        else:
            feature[part] = value
    return json.dumps(feature)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{", "Expecting property name"),
        ("[1]", "not a draw as GeoJSON Feature"),
        (spoilt(geometry=None), "not a draw as GeoJSON Feature"),
        (spoilt(geometry_type="Point"), "must be a Feature of MultiLineString"),
        (spoilt(properties_anchor_black=1), "anchor_black"),
        (spoilt(properties_window=[0, 0, 0, 1]), "needs X0 < X1"),
        (spoilt(properties_window=[0, 0, 2, 1]), "another window"),
        (spoilt(geometry_coordinates=[[[0, 0]]]), "cannot reshape"),
        (spoilt(geometry_coordinates=[[[0, 0], [1, float("nan")]]]), "finite"),
    ],
)
def test_an_unreadable_line_is_named(line: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.geojsonl"
    path.write_bytes(f"{spoilt()}\n{line}\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"bad\.geojsonl:2: ") as caught:
        read_geojsonl(path)
    assert message in str(caught.value)


def test_missing_and_empty_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.geojsonl"):
        read_geojsonl(tmp_path / "none.geojsonl")
    (tmp_path / "empty.geojsonl").write_text("\n")
    with pytest.raises(InputError, match="holds no draw"):
        read_geojsonl(tmp_path / "empty.geojsonl")


# Coloring to polygons and back; areas by three routes.


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
