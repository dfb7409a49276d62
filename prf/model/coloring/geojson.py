"""Colorings as GeoJSON: one Feature a coloring, one two-point line an edge, full double precision."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from prf.model.coloring.graph import Coloring, Draws
from prf.model.coloring.polygons import from_segments
from prf.model.window import Window
from prf.shell.cli.files import open_input
from prf.shell.errors import ConfigError, InputError


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


def from_feature(feature: Any) -> Coloring:
    """Return the coloring of a Feature made by :func:`to_feature` or by another program that keeps its form.

    Equal coordinates are one vertex; coordinates on the border are on that side. Validity of the graph is not checked:
    see :func:`prf.model.coloring.check`.
    """
    try:
        geometry, properties = feature["geometry"], feature["properties"]
        if (feature["type"], geometry["type"]) != ("Feature", "MultiLineString"):
            raise InputError(f"{feature['type']} of {geometry['type']}, must be a Feature of MultiLineString")
        lines, window = geometry["coordinates"], Window.checked(*properties["window"])
        ends = np.array(lines, dtype=np.float64).reshape(len(lines), 2, 2)
        anchor_black = properties["anchor_black"]
    except (LookupError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"not a draw as GeoJSON Feature ({type(error).__name__}: {error})") from error
    if not isinstance(anchor_black, bool) or not np.isfinite(ends).all():
        raise InputError("anchor_black must be true or false, and all coordinates finite numbers")
    return from_segments(ends, window, anchor_black)


def feature_lines(draws: Draws) -> Iterator[str]:
    """Yield one line of JSON for each draw, without its line end."""
    for coloring in draws:
        yield json.dumps(to_feature(coloring), separators=(",", ":"), allow_nan=False)


def read_geojsonl(path: str | os.PathLike[str]) -> Draws:
    """Read one Feature a line; blank lines are skipped, ``-`` is standard input."""
    colorings: list[Coloring] = []
    with open_input(path) as stream:
        for number, line in enumerate(stream, start=1):
            if line.strip():
                try:
                    colorings.append(from_feature(json.loads(line)))
                except (InputError, ConfigError, ValueError, RecursionError) as error:
                    raise InputError(
                        f"{path}:{number}: {error}. Each line must be one draw as GeoJSON Feature."
                    ) from None
                if colorings[0].window != colorings[-1].window:
                    raise InputError(f"{path}:{number}: another window than that of the first draw.")
    if not colorings:
        raise InputError(f"{path}: holds no draw. Each line must be one draw as GeoJSON Feature.")
    return Draws.from_colorings(colorings)
