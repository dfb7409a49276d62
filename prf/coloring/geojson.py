"""Colorings as GeoJSON: one Feature a coloring, one two-point line an edge, full double precision."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from prf.coloring.graph import Coloring, Draws
from prf.coloring.polygons import sides_of
from prf.shell.errors import ConfigError, InputError
from prf.shell.files import atomic_write, open_input
from prf.window import Window

LARGEST = 1e300
"""Beyond it lie coordinates of no map, and whole numbers that no float holds."""


def to_feature(coloring: Coloring) -> dict[str, Any]:
    """Return a GeoJSON Feature: MultiLineString of the edges, properties ``anchor_black`` and ``window``.

    ``json.dumps`` writes each coordinate by ``repr``, so that reading gives the same double back: shared vertices stay
    identical and boundary vertices exactly on the border.
    """
    return {
        "type": "Feature",
        "properties": {"anchor_black": bool(coloring.anchor_black), "window": [float(b) for b in coloring.window]},
        "geometry": {"type": "MultiLineString", "coordinates": coloring.xy[coloring.edges].tolist()},
    }


def from_feature(feature: Mapping[str, Any], window: Window | None = None) -> Coloring:
    """Return the coloring of a Feature made by :func:`to_feature` or by another program that keeps its form.

    Parameters
    ----------
    feature : mapping
        GeoJSON Feature. Equal coordinates are one vertex; coordinates on the border are on that side.
    window : Window, optional
        Needed if the Feature has no property ``window``; otherwise it must be the same.

    Returns
    -------
    Coloring
        Validity of the graph is not checked: see :func:`prf.coloring.check`.
    """
    properties, geometry = feature.get("properties"), feature.get("geometry")
    if feature.get("type") != "Feature" or not isinstance(properties, Mapping) or not isinstance(geometry, Mapping):
        raise InputError("not a GeoJSON Feature with properties and geometry")
    if geometry.get("type") != "MultiLineString":
        raise InputError(f"geometry is {geometry.get('type')!r}, must be 'MultiLineString'")
    anchor_black = properties.get("anchor_black")
    if not isinstance(anchor_black, bool):
        raise InputError("property anchor_black must be true or false")
    window = _window(properties.get("window"), window)
    index: dict[tuple[float, float], int] = {}
    edges = [
        [index.setdefault(vertex, len(index)) for vertex in _ends(line, number)]
        for number, line in enumerate(_lines(geometry))
    ]
    xy = np.array(list(index), dtype=np.float64).reshape(-1, 2)
    return Coloring(window, xy, sides_of(xy, window), np.array(edges, dtype=np.int32).reshape(-1, 2), anchor_black)


def feature_lines(draws: Draws) -> Iterator[str]:
    """Yield one line of JSON for each draw, without its line end."""
    for coloring in draws:
        yield json.dumps(to_feature(coloring), separators=(",", ":"), allow_nan=False)


def write_geojsonl(path: str | os.PathLike[str], draws: Draws) -> None:
    """Write one Feature a line, atomically, over whatever is there (OutputError if it cannot be written)."""
    with atomic_write(path) as stream:
        stream.writelines(line + "\n" for line in feature_lines(draws))


def read_geojsonl(path: str | os.PathLike[str], window: Window | None = None) -> Draws:
    """Read one Feature a line; blank lines are skipped, ``-`` is standard input.

    Parameters
    ----------
    window : Window, optional
        For Features without the property ``window``.
    """
    colorings: list[Coloring] = []
    with open_input(path) as stream:
        for number, line in enumerate(stream, start=1):
            if not line.strip():
                continue
            try:
                colorings.append(from_feature(_object(line), window))
            except (InputError, ConfigError) as error:
                raise InputError(f"{path}:{number}: {error}. Each line must be one draw as GeoJSON Feature.") from None
            window = colorings[-1].window
    if not colorings:
        raise InputError(f"{path}: holds no draw. Each line must be one draw as GeoJSON Feature.")
    return Draws.from_colorings(colorings)


def _object(line: bytes) -> Mapping[str, Any]:
    """Return the JSON object on a line."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON ({error})") from error
    if not isinstance(value, Mapping):
        raise InputError("not a JSON object")
    return value


def _window(stored: object, known: Window | None) -> Window:
    """Return the window that the Feature stores, which must agree with the `known` one, or else that one."""
    if stored is None and known is not None:
        return known
    if stored is None:
        raise InputError("property window is missing and no window is given")
    if not isinstance(stored, list) or len(stored) != 4 or not all(_is_number(bound) for bound in stored):
        raise InputError("property window must be [x_min, y_min, x_max, y_max]")
    window = Window.checked(*stored)
    if known is not None and window != known:
        raise InputError(f"window {list(window)} differs from {list(known)}")
    return window


def _lines(geometry: Mapping[str, Any]) -> list[Any]:
    lines = geometry.get("coordinates")
    if not isinstance(lines, list):
        raise InputError("geometry has no list of coordinates")
    return lines


def _ends(line: object, number: int) -> Iterator[tuple[float, float]]:
    """Yield the two ends of an edge."""
    if not isinstance(line, list) or len(line) != 2:
        raise InputError(f"edge {number} must have two points")
    for point in line:
        if not isinstance(point, list) or len(point) != 2 or not all(_is_number(value) for value in point):
            raise InputError(f"edge {number} must have points [x, y] of finite numbers")
        yield float(point[0]), float(point[1])


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < LARGEST
