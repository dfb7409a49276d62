"""Polygonal maps as GeoJSON: those that prf writes, which GIS programs open as they are, and those of any program."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.errors import ShapelyError
from shapely.geometry.base import BaseGeometry

from prf.model.coloring import Coloring, from_polygons, oriented_polygons
from prf.model.coloring.polygons import refuse_far
from prf.model.window import Window
from prf.results import names
from prf.shell.cli.files import open_input
from prf.shell.cli.storage import dump_object, load_object
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


MAP_SCHEMA = names.SCHEMAS[names.MAP]
STAIRCASE = 0.75
"""Cells by which outlines of cells may be straightened: a staircase at 45 degrees leaves its line by 0.71."""


DAMAGE = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, ShapelyError)
"""What damaged GeoJSON raises."""
COLLECTIONS = {"FeatureCollection": "features", "GeometryCollection": "geometries"}


class OccupiedArea(NamedTuple):
    """Occupied area, and the window within which it is known (None: free wherever there is no polygon)."""

    region: BaseGeometry
    window: Window | None


@np.errstate(all="ignore")  # GEOS divides by zero and overflows internally, of which numpy warns
def read_occupied_area(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read every Polygon and MultiPolygon of a GeoJSON file: a geometry, a Feature or a FeatureCollection.

    `path`: ``-`` is standard input. The property ``window``, ``[x_min, y_min, x_max, y_max]``, of the first object that
    has it is where the map is known. Returns: overlapping polygons united, clipped to the window.
    """
    content = _load(path)
    try:
        polygons = [polygon for geometry in _geometries(content) for polygon in _polygons(geometry)]
        window = next((Window.checked(*bounds) for bounds in _windows(content)), None)
        region = shapely.union_all(shapely.force_2d(np.array(polygons, dtype=object)))
        if window is not None and not shapely.covers(shapely.box(*window), region):
            region = shapely.intersection(region, shapely.box(*window))
    except (InputError, ConfigError) as error:
        raise InputError(f"{path}: {error}") from error
    except DAMAGE as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: not a GeoJSON map ({type(error).__name__}: {reason}). Give polygons of the occupied area."
        ) from error
    return OccupiedArea(region, window)


def _load(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    with open_input(path) as stream:
        data = stream.read()
    try:
        content = json.loads(data)
    except (ValueError, RecursionError) as error:
        reason = "no text" if isinstance(error, UnicodeDecodeError) else f"not JSON: {' '.join(str(error).split())}"
        raise InputError(f"{path}: neither a RUN, a GRID nor GeoJSON ({reason}).") from error
    if not isinstance(content, Mapping):
        raise InputError(f"{path}: not a GeoJSON object. Give polygons of the occupied area.")
    schema = str(content.get("schema", ""))
    if schema.startswith("prf.") and schema != MAP_SCHEMA:
        raise InputError(f"{path}: schema {schema}, expected {MAP_SCHEMA} or GeoJSON of another program.")
    return content


def _geometries(content: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Yield the geometries of a GeoJSON object."""
    kind = content["type"]
    if kind in COLLECTIONS:
        for member in content[COLLECTIONS[kind]]:
            yield from _geometries(member)
    elif kind == "Feature":
        if content["geometry"] is not None:
            yield from _geometries(content["geometry"])
    else:
        yield content


def _polygons(geometry: Mapping[str, Any]) -> Iterator[BaseGeometry]:
    """Yield the polygons of a geometry, each of them valid."""
    if geometry["type"] not in ("Polygon", "MultiPolygon"):
        raise InputError(f"geometry {geometry['type']}: expected Polygon or MultiPolygon.")
    if not geometry["coordinates"]:
        return
    for polygon in shapely.get_parts(shapely.geometry.shape(geometry)):
        refuse_far(polygon)
        if not shapely.is_valid(polygon):
            raise InputError(f"a polygon is not valid ({shapely.is_valid_reason(polygon)}). Repair it.")
        yield polygon


def _windows(content: Mapping[str, Any]) -> Iterator[Any]:
    """Yield the properties ``window`` of an object and of its Features."""
    for holder in (content, *content.get("features", [])):
        properties = holder.get("properties")
        if isinstance(properties, Mapping) and properties.get("window") is not None:
            yield properties["window"]


def outline_of_cells(occupied: NDArray[np.bool_], origin: NDArray[np.float64], side: float) -> BaseGeometry:
    """Return the exact area of cells (ny, nx) of a side in metres, row 0 with the lowest y, from `origin` (2,) on."""
    step = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(step == 1)
    end = np.nonzero(step == -1)[1]
    x, y = origin
    runs = shapely.box(x + side * first, y + side * row, x + side * end, y + side * (row + 1))
    return shapely.union_all(runs)


def area_of_cells(occupied: NDArray[np.bool_], origin: NDArray[np.float64], side: float) -> BaseGeometry:
    """Return the area of :func:`outline_of_cells`, its staircases straightened (Douglas and Peucker)."""
    runs = outline_of_cells(occupied, origin, side)
    simple = shapely.simplify(runs, STAIRCASE * side, preserve_topology=True)
    parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(simple)))
    return shapely.union_all(parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON])
