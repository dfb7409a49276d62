"""Maps against a true plan: which cells count, and what is made of them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from prf.model.coloring import Draws, black_at, from_polygons
from prf.model.window import Window
from prf.readings import Readings
from prf.results import map_text
from prf.results.occupancy import OccupancyGrid
from prf.results.score import (
    DrawsMap,
    GridMap,
    HeldOut,
    HeldOutSonar,
    OccupiedArea,
    PolygonMap,
    hold_out,
    hold_out_sonar,
    read_occupied_area,
    score,
    true_cells,
)
from prf.results.score.poses import Floats, Ints, integrate, pooled
from prf.shell.errors import InputError
from tests.factories import WINDOW, random_draws, score_settings

ROOM = Window(0.0, 0.0, 10.0, 8.0)
WALL = shapely.box(6.0, 0.0, 7.0, 8.0)
PLAN = OccupiedArea(WALL, ROOM)


def beams_from(x: float, y: float, angles: object, max_range: float = 8.0) -> HeldOut:
    n = np.size(angles)
    return hold_out(
        Readings.from_arrays(np.tile([x, y], (n, 1)), np.ravel(angles), np.full(n, 1.0)),
        score_settings(max_range=max_range),
    )


def cone_from(x: float, y: float, angle: float, view: float) -> HeldOutSonar:
    return hold_out_sonar(Readings.from_arrays([[x, y]], [angle], [1.0], cone=view), score_settings())


class TestCells:
    def test_without_readings_every_cell_counts(self) -> None:
        cells = true_cells(PLAN, None, None)
        assert len(cells.xy) == 8000
        assert cells.occupied.sum() == 800
        np.testing.assert_allclose(cells.xy[[0, -1]], [[0.05, 0.05], [9.95, 7.95]])
        assert (cells.occupied == ((cells.xy[:, 0] > 6.0) & (cells.xy[:, 0] < 7.0))).all()

    def test_a_beam_counts_its_free_cells_and_the_wall_that_it_meets(self) -> None:
        """Its reading, 1 m, does not matter: the plan determines how far it reaches."""
        cells = true_cells(PLAN, beams_from(2.0, 4.05, [0.0]), None)
        free, occupied = cells.xy[~cells.occupied], cells.xy[cells.occupied]
        np.testing.assert_allclose(free, np.column_stack([np.arange(2.05, 6.0, 0.1), np.full(40, 4.05)]))
        # Up to 0.2 m from the last free middle at 5.95: two cells ahead, and one to each side of the first.
        assert sorted(np.round(occupied, 2).tolist()) == [[6.05, 3.95], [6.05, 4.05], [6.05, 4.15], [6.15, 4.05]]

    def test_the_maximum_range_and_the_window_end_a_beam(self) -> None:
        assert len(true_cells(PLAN, beams_from(2.0, 4.05, [0.0], 2.0), None).xy) == 20
        back = true_cells(PLAN, beams_from(2.0, 4.05, [math.pi]), None)
        assert len(back.xy) == 20
        assert back.xy[:, 0].min() == pytest.approx(0.05)

    def test_a_cone_counts_what_it_sees(self) -> None:
        at, view = np.array([2.0, 4.0]), 0.6
        cells = true_cells(PLAN, None, cone_from(*at, 0.0, view))
        assert not cells.occupied.any()  # 3.5 m end before the wall
        offset = cells.xy - at
        assert np.hypot(*offset.T).max() < 3.5 + 0.08
        assert np.abs(np.arctan2(offset[:, 1], offset[:, 0]))[np.hypot(*offset.T) > 1.0].max() < 0.5 * view + 0.08
        # Cells that the border of the cone cuts count whole: half a cell more all round.
        around = 0.5 * 0.1 * (2.0 + view) * 3.5
        assert len(cells.xy) * 0.01 == pytest.approx(0.5 * view * 3.5**2 + around, rel=0.05)

    def test_nothing_behind_a_wall_is_in_view(self) -> None:
        cells = true_cells(
            PLAN, beams_from(2.0, 4.0, np.linspace(-3.1, 3.1, 2000), 30.0), cone_from(4.0, 2.0, 0.0, 1.0)
        )
        assert cells.xy[:, 0].max() < 6.3
        assert (~cells.occupied).sum() == 60 * 80

    @pytest.mark.parametrize("has_window", [True, False])
    def test_cells_whose_middle_lies_beyond_the_window_do_not_count(self, has_window: bool) -> None:
        window = Window(-1.0, 2.0, 3.03, 5.04)
        region = shapely.box(*window) - shapely.box(0.0, 3.0, 2.5, 5.0)
        plan = OccupiedArea(region, window if has_window else None)
        for beams in (None, beams_from(1.0, 4.0, np.linspace(-3.0, 3.0, 200))):
            cells = true_cells(plan, beams, None)
            assert window.contains(cells.xy).all()
            found = score(PolygonMap(plan), None, cells=cells)
            assert (found["iou_occupied"], found["iou_free"], found["cell_brier"]) == (1.0, 1.0, 0.0)
        assert len(true_cells(plan, None, None).xy) == 40 * 30

    def test_what_has_no_cells(self) -> None:
        with pytest.raises(InputError, match="less than a cell"):
            true_cells(OccupiedArea(shapely.box(0.0, 0.0, 0.04, 1.0), None), None, None)
        with pytest.raises(InputError, match="window"):
            true_cells(OccupiedArea(shapely.MultiPolygon(), None), None, None)
        for x in (6.5, 50.0):  # in the wall, and outside
            with pytest.raises(InputError, match="in view"):
                true_cells(PLAN, beams_from(x, 4.0, [0.0]), None)
        with pytest.raises(InputError, match="in metres"):
            true_cells(OccupiedArea(WALL, Window(0.0, 0.0, 1e4, 1e4)), None, None)


class TestScores:
    def test_the_plan_itself_is_right(self) -> None:
        found = score(PolygonMap(PLAN), None, cells=true_cells(PLAN, None, None))
        assert found == {
            "kind": "map",
            "n_draws": 1,
            "n_cells": 8000,
            "n_cells_occupied": 800,
            "iou_occupied": 1.0,
            "iou_free": 1.0,
            "cell_brier": 0.0,
            "cell_nll": pytest.approx(-math.log(0.999)),
            "cell_unknown": 0.0,
        }

    def test_a_wall_moved_by_half_its_width(self) -> None:
        moved = OccupiedArea(shapely.box(6.5, 0.0, 7.5, 8.0), ROOM)
        found = score(PolygonMap(moved), None, cells=true_cells(PLAN, None, None))
        assert found["iou_occupied"] == pytest.approx(1.0 / 3.0)
        assert found["iou_free"] == pytest.approx((90 - 5) / (90 + 5))
        assert found["cell_brier"] == pytest.approx(0.1)

    def test_what_is_not_known_is_neither(self) -> None:
        """The left half of the window is known to be free; of the rest, wall included, nothing is."""
        occupancy = np.full((80, 50), 0.1, np.float32)
        none = np.zeros((80, 50), np.int32)
        half = GridMap(OccupancyGrid(occupancy, none, none, np.zeros(2), 0.1))
        found = score(half, None, cells=true_cells(PLAN, None, None))
        assert (found["iou_occupied"], found["cell_unknown"]) == (0.0, 0.5)
        assert found["iou_free"] == pytest.approx(5.0 / 9.0)
        assert found["cell_brier"] == pytest.approx(0.5 * 0.01 + 0.5 * 0.25, rel=1e-6)
        assert found["cell_nll"] == pytest.approx(-0.5 * math.log(0.9) - 0.5 * math.log(0.5), rel=1e-6)

    def test_draws_vote(self) -> None:
        draws = random_draws(3, 5)
        plan = OccupiedArea(shapely.box(0.0, 0.0, 5.0, 5.0), WINDOW)
        cells = true_cells(plan, None, None)
        found = score(DrawsMap(draws, None), None, cells=cells)
        share = np.mean([black_at(draw, cells.xy) for draw in draws], axis=0)
        black, true = share > 0.5, cells.occupied
        assert found["iou_occupied"] == pytest.approx((black & true).sum() / (black | true).sum())
        assert found["cell_brier"] == pytest.approx(((share - true) ** 2).mean())

    def test_one_draw_scores_as_its_map(self) -> None:
        box = shapely.box(1.0, 1.0, 2.5, 3.3)
        coloring = from_polygons(box, ROOM)
        cells = true_cells(PLAN, beams_from(4.0, 4.0, np.linspace(-3.0, 3.0, 60)), None)
        one = score(PolygonMap(OccupiedArea(box, ROOM)), None, cells=cells)
        many = score(DrawsMap(Draws.from_colorings([coloring]), coloring), None, cells=cells)
        assert {**one, "kind": "run"} == many

    def test_nothing_to_overlap_is_no_number(self) -> None:
        free = OccupiedArea(shapely.MultiPolygon(), ROOM)
        found = score(PolygonMap(free), None, cells=true_cells(free, None, None))
        assert math.isnan(found["iou_occupied"])
        assert found["iou_free"] == 1.0


# Adaptive importance sampling against integrals of normals, which have a closed form.


@pytest.mark.parametrize("deviation", [0.02, 0.3, 5.0])
@pytest.mark.parametrize("is_known", [False, True])
def test_normals_narrow_and_wide(deviation: float, is_known: bool) -> None:
    rng = np.random.default_rng(4)
    n, mixing = 40, rng.normal(size=(3, 3))
    scale = deviation * mixing @ mixing.T / np.linalg.norm(mixing @ mixing.T)
    covariance = scale @ scale + (0.2 * deviation) ** 2 * np.eye(3)
    middle = 1.3 * rng.normal(size=(n, 3))

    def target(scans: Ints, errors: Floats) -> Floats:
        away = errors - middle[scans]
        return np.asarray(-0.5 * np.einsum("kni,ij,knj->kn", away, np.linalg.inv(covariance), away))

    found = integrate(target, n, None, 30.0, rng)
    if is_known:
        found = integrate(target, n, pooled([found.posterior]), 30.0, rng)
    total = np.eye(3) + covariance
    quadratic = np.einsum("ni,ij,nj->n", middle, np.linalg.inv(total), middle)
    expected = 0.5 * (np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(total)[1] - quadratic)
    error = found.log_value - expected
    assert abs(error.mean()) < 0.08
    assert error.std() < 0.35
    assert found.ess.min() >= 30.0
    spread = covariance @ np.linalg.inv(total)
    away = found.posterior.mean - middle @ np.linalg.inv(total)
    assert np.sqrt((away**2).mean() / np.trace(spread) * 3.0) < 0.3
    assert np.trace(found.posterior.covariance, axis1=1, axis2=2).mean() == pytest.approx(np.trace(spread), rel=0.2)


# GeoJSON of whatever program: its forms, its window, what is refused.


SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]]}
FAR = {"type": "MultiPolygon", "coordinates": [[[[5, 5, 9], [6, 5, 9], [6, 6, 9], [5, 5, 9]]]]}


def read(tmp_path: Path, content: Any) -> OccupiedArea:
    (tmp_path / "map.geojson").write_text(content if isinstance(content, str) else json.dumps(content))
    return read_occupied_area(tmp_path / "map.geojson")


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties or None}


@pytest.mark.parametrize(
    ("content", "area"),
    [
        (SQUARE, 4.0),
        (FAR, 0.5),
        (feature(SQUARE), 4.0),
        (feature(None), 0.0),
        ({"type": "Polygon", "coordinates": []}, 0.0),
        ({"type": "FeatureCollection", "features": [feature(SQUARE), feature(FAR)]}, 4.5),
        ({"type": "GeometryCollection", "geometries": [SQUARE, FAR, SQUARE]}, 4.5),
    ],
)
def test_forms(tmp_path: Path, content: Any, area: float) -> None:
    found = read(tmp_path, content)
    assert found.region.area == area
    assert found.window is None
    assert not shapely.has_z(found.region)


def test_the_window_clips(tmp_path: Path) -> None:
    found = read(tmp_path, feature(SQUARE, window=[1, 1, 9, 9]))
    assert (found.region.area, found.window) == (1.0, Window(1.0, 1.0, 9.0, 9.0))
    collection = {"type": "FeatureCollection", "features": [feature(SQUARE), feature(FAR, window=[1, 1, 9, 9])]}
    assert read(tmp_path, collection).window == Window(1.0, 1.0, 9.0, 9.0)


@pytest.mark.parametrize("black", [False, True])
def test_maps_of_our_own(tmp_path: Path, black: bool) -> None:
    window = Window(0.0, 0.0, 4.0, 4.0)
    coloring = from_polygons(shapely.box(0, 0, 2, 4) if not black else shapely.box(*window), window)
    found = read(tmp_path, map_text(coloring._replace(anchor_black=black or coloring.anchor_black), {}))
    assert found.window == window
    np.testing.assert_allclose(found.region.area, 16.0 if black else 8.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("not json", "neither a RUN, a GRID nor GeoJSON"),
        ("{}", "not a GeoJSON map"),
        ({"type": "LineString", "coordinates": [[0, 0], [1, 1]]}, "LineString"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]]}, "not valid"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 0], [2, 2], [0, 0]]]}', "not finite"),
        (feature(SQUARE, window=[3, 0, 1, 1]), "window"),
        ({**feature(SQUARE), "schema": "prf.map/2"}, "schema prf.map/2"),
    ],
)
def test_what_is_no_map(tmp_path: Path, content: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path, content)
    assert "map.geojson" in str(caught.value)
    assert "\n" not in str(caught.value)
