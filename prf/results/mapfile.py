"""A polygonal map as GeoJSON: the occupied area as one Feature, which GIS programs open as it is."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from prf.model.coloring import Coloring, from_polygons, oriented_polygons
from prf.model.window import Window
from prf.results import names
from prf.shell.cli.jsonout import dump_object
from prf.shell.cli.storage import load_object
from prf.shell.errors import ConfigError, InputError


def map_feature(coloring: Coloring, properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return the Feature of a map: a MultiPolygon, with the window, sizes and `properties` as its properties.

    Outer rings run counter-clockwise and holes clockwise: programs that take coordinates for those of a globe see all
    but the polygon in a ring of the other sense.
    """
    return {
        "type": "Feature",
        "geometry": shapely.geometry.mapping(oriented_polygons(coloring)),
        "properties": {
            **properties,
            "n_edges": coloring.n_edges,
            "n_vertices": coloring.n_vertices,
            "frame": "metres",
            "window": list(coloring.window),
            "anchor_black": bool(coloring.anchor_black),
        },
    }


def map_text(coloring: Coloring, properties: Mapping[str, Any]) -> str:
    """Return the text of a map file; coordinates keep full double precision."""
    return dump_object(names.SCHEMAS[names.MAP], map_feature(coloring, properties)) + "\n"


def read_map_feature(path: str | os.PathLike[str]) -> tuple[Coloring, dict[str, Any]]:
    """Return the coloring of a map that prf wrote, and its properties."""
    file = Path(path)
    content = load_object(file, names.SCHEMAS[names.MAP])
    try:
        properties = dict(content["properties"])
        window = Window.checked(*properties["window"])
        coloring = from_polygons(_geometry(content["geometry"]), window)
        if coloring.n_edges == 0:  # all of the window, or nothing: no ring shows which
            coloring = Coloring.empty(window, bool(properties["anchor_black"]))
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, shapely.errors.ShapelyError) as error:
        raise InputError(f"{file}: not a map that prf wrote ({type(error).__name__}: {error}).") from error
    except (ConfigError, InputError) as error:
        raise InputError(f"{file}: {error}") from error
    return coloring, properties


def _geometry(content: Mapping[str, Any]) -> BaseGeometry:
    """Return the MultiPolygon of a Feature (shapely takes no empty coordinate list)."""
    if content["type"] != "MultiPolygon":
        raise ValueError(f"geometry {content['type']}, expected MultiPolygon")
    with np.errstate(invalid="ignore"):  # the coloring refuses nan
        return shapely.geometry.shape(content) if content["coordinates"] else shapely.MultiPolygon()
