"""GeoJSON of whatever program: its forms, its window, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from prf.model.coloring import from_polygons
from prf.model.window import Window
from prf.results import map_text
from prf.results.score import OccupiedArea, read_occupied_area
from prf.shell.errors import InputError

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
