"""GeoJSON, SVG and DXF: each read back, each the area that the map has."""

from __future__ import annotations

import io
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, oriented_polygons
from prf.model.window import Window
from prf.output.export.drawings import dxf_text, paper_ratio, svg_text
from prf.output.export.export import _counts as counts
from prf.output.export.source import read_source
from prf.results import map_text, read_map_feature
from tests.factories import WINDOW, random_draws

SVG = "{http://www.w3.org/2000/svg}"
MAPS = [*random_draws(5, 4), Coloring.empty(WINDOW), Coloring.empty(WINDOW, black=True)]


def area_of(coloring: Coloring) -> float:
    return float(black_areas(Draws.from_colorings([coloring]))[0])


def read_svg(text: str) -> tuple[ElementTree.Element, shapely.Geometry]:
    """Return the document, and the area that its paths fill by the even-odd rule."""
    root = ElementTree.fromstring(text)
    group = root.find(f"{SVG}g[@id='map']/{SVG}g[@id='occupied']")
    assert group.get("fill-rule") == "evenodd"
    filled = shapely.Polygon()
    for path in group:
        for ring in re.findall(r"M([^Z]*)Z", path.get("d")):
            corners = [tuple(map(float, corner.split())) for corner in ring.split("L")]
            filled = filled.symmetric_difference(shapely.make_valid(shapely.Polygon(corners)))
    return root, filled


def read_dxf(text: str):
    ezdxf = pytest.importorskip("ezdxf")
    return ezdxf.read(io.StringIO(text))


@pytest.mark.parametrize("coloring", MAPS)
def test_geojson_is_valid_oriented_and_read_again(coloring: Coloring, tmp_path: Path) -> None:
    area = oriented_polygons(coloring)
    (tmp_path / "map.geojson").write_text(map_text(coloring, {"log_posterior": -1.5}))
    feature = json.loads((tmp_path / "map.geojson").read_text())
    shape = shapely.geometry.shape(feature["geometry"]) if len(area.geoms) else area
    assert (feature["type"], feature["geometry"]["type"]) == ("Feature", "MultiPolygon")
    assert shapely.is_valid(shape)
    assert shape.area == pytest.approx(area_of(coloring), abs=1e-9)
    for polygon in shape.geoms:
        assert polygon.exterior.is_ccw
        assert not any(ring.is_ccw for ring in polygon.interiors)
    read, properties = read_map_feature(tmp_path / "map.geojson")
    assert sorted(map(sorted, read.xy[read.edges].tolist())) == sorted(
        map(sorted, coloring.xy[coloring.edges].tolist())
    )
    assert (read.anchor_black, properties["log_posterior"]) == (coloring.anchor_black, -1.5)


@given(st.integers(0, 2**32 - 1))
def test_any_map_of_the_prior_is_valid_and_coloured_right(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coloring = exact_draws(0.3, WINDOW, 1, rng)[0]
    area = oriented_polygons(coloring)
    assert shapely.is_valid(area)
    xy = rng.uniform(WINDOW[:2], WINDOW[2:], (50, 2))
    np.testing.assert_array_equal(shapely.contains_xy(area, xy), black_at(coloring, xy))


def test_holes_are_kept_and_counted() -> None:
    areas = [oriented_polygons(coloring) for coloring in MAPS]
    found = [counts(area) for area in areas]
    assert sum(one["n_holes"] for one in found) > 0
    assert tuple(found[-2].values()) == (0, 0, 0, 0.0)
    assert tuple(found[-1].values()) == (1, 0, 4, WINDOW.area)
    for area, one in zip(areas, found, strict=True):
        rings = [ring for polygon in area.geoms for ring in (polygon.exterior, *polygon.interiors)]
        assert one["n_vertices"] == sum(len(ring.coords) - 1 for ring in rings)


@pytest.mark.parametrize("coloring", MAPS)
def test_svg_fills_the_occupied_area_in_metres(coloring: Coloring) -> None:
    area = oriented_polygons(coloring)
    root, filled = read_svg(svg_text(area, WINDOW, "a < b & c"))
    assert filled.area == pytest.approx(area.area, abs=1e-4 * area.length + 1e-9)
    assert filled.symmetric_difference(area).area <= 1e-4 * area.length + 1e-9
    assert root.find(f"{SVG}title").text == "a < b & c"
    assert root.find(f"{SVG}g[@id='map']").get("transform") == "scale(1 -1)"


@pytest.mark.parametrize(
    ("window", "ratio"),
    [
        (WINDOW, 100),
        (Window(0, 0, 41, 30), 200),
        (Window(0, 0, 1, 2), 5),
        (Window(499_950.0, 4_000_000.0, 500_050.0, 4_000_300.0), 1000),
    ],
)
def test_svg_states_its_scale(window: Window, ratio: int) -> None:
    root, _ = read_svg(svg_text(shapely.MultiPolygon(), window, "map"))
    assert paper_ratio(window) == ratio
    x, y, width, height = map(float, root.get("viewBox").split())
    assert (x, -y) == pytest.approx((window.x_min, window.y_max))
    assert float(root.get("width").removesuffix("mm")) == pytest.approx(1e3 * width / ratio, abs=1e-3)
    assert float(root.get("height").removesuffix("mm")) == pytest.approx(1e3 * height / ratio, abs=1e-3)
    assert width == pytest.approx(window.width)
    bar = root.find(f"{SVG}g[@id='scale']")
    words = bar.find(f"{SVG}text").text
    assert words.endswith(f" m, 1:{ratio}")
    start, end = re.search(r"M([-\d.]+) .*H([-\d.]+)V", bar.find(f"{SVG}path").get("d")).groups()
    assert float(end) - float(start) == pytest.approx(float(words.split()[0]))


@pytest.mark.parametrize("coloring", MAPS)
def test_dxf_is_sound_and_has_every_ring(coloring: Coloring) -> None:
    area = oriented_polygons(coloring)
    document = read_dxf(dxf_text(area, WINDOW, "office, best map"))
    audit = document.audit()
    assert (audit.errors, audit.fixes) == ([], [])
    assert (document.units, document.header["$MEASUREMENT"]) == (6, 1), "metres"
    lines = list(document.modelspace())
    assert all(line.dxftype() == "LWPOLYLINE" and line.closed for line in lines)
    rings = [shapely.Polygon(line.get_points("xy")) for line in lines if line.dxf.layer == "OCCUPIED"]
    assert len(rings) == sum(list(counts(area).values())[:2])
    signed = [ring.area if ring.exterior.is_ccw else -ring.area for ring in rings]
    assert sum(signed) == pytest.approx(area.area)
    filled = shapely.Polygon()
    for ring in rings:
        filled = filled.symmetric_difference(ring)
    assert shapely.equals(filled, area) or filled.symmetric_difference(area).area < 1e-9
    (outline,) = [line for line in lines if line.dxf.layer == "OUTLINE"]
    assert shapely.Polygon(outline.get_points("xy")).equals(shapely.box(*WINDOW))


def test_dxf_keeps_coordinates_to_the_last_bit() -> None:
    area = oriented_polygons(MAPS[0])
    document = read_dxf(dxf_text(area, WINDOW, "map"))
    written = {
        corner for polygon in area.geoms for ring in (polygon.exterior, *polygon.interiors) for corner in ring.coords
    }
    lines = document.modelspace().query('LWPOLYLINE[layer=="OCCUPIED"]')
    assert {(float(x), float(y)) for line in lines for x, y in line.get_points("xy")} == written


def test_polygons_of_another_program_get_a_metre_of_window_round_them(tmp_path: Path) -> None:
    spike = shapely.Polygon([(0.0, 0.0), (10.0, 1.0), (0.0, 2.0)])
    (tmp_path / "spike.geojson").write_text(json.dumps(shapely.geometry.mapping(spike)))
    assert read_source(tmp_path / "spike.geojson").choose_map(None).coloring.window == (-1.0, -1.0, 11.0, 3.0)
