"""DRAWS files: exact round trips, files of other programs, unreadable lines."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, feature_lines, from_feature, read_geojsonl, to_feature, violations
from prf.model.window import Window
from prf.shell.errors import InputError
from tests.factories import write_draws

UNIT = Window(0.0, 0.0, 1.0, 1.0)
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
