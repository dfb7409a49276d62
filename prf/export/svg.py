"""The occupied area as SVG: paths in metres with y up, drawn to a round scale, with a bar that says so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from prf.window import Window

LARGEST_SIDE = 0.4
"""Metres of paper: the longer side of an A3 page with margins."""
DECIMALS = 4
"""A tenth of a millimetre in the world."""
STRIP = 0.06
"""Height of the strip with the scale bar below the map, as a share of the window's longer side."""


def svg_text(area: MultiPolygon, window: Window, title: str) -> str:
    """Return the text of an SVG file.

    Parameters
    ----------
    area : shapely.MultiPolygon
        The occupied area in metres.
    window : Window
    title : str

    Notes
    -----
    One unit of the drawing is a metre. The group ``map`` turns y up, so that coordinates in it are those of the map.
    """
    ratio = paper_ratio(window)
    strip = STRIP * max(window.width, window.height)
    height = window.height + strip
    size = f'width="{_number(1e3 * window.width / ratio)}mm" height="{_number(1e3 * height / ratio)}mm"'
    box = f"{_number(window.x_min)} {_number(-window.y_max)} {_number(window.width)} {_number(height)}"
    corner = f'x="{_number(window.x_min)}" y="{_number(window.y_min)}"'
    extent = f'width="{_number(window.width)}" height="{_number(window.height)}"'
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{box}">',
        f"<title>{escape(title)}</title>",
        f"<desc>Occupied area. One unit is one metre, y points up in the group map, scale 1:{ratio:g}.</desc>",
        '<g id="map" transform="scale(1 -1)">',
        '<g id="occupied" fill="#1f2328" fill-rule="evenodd">',
        *(f'<path d="{path_data(polygon)}"/>' for polygon in area.geoms),
        "</g>",
        f'<rect id="window" {corner} {extent} fill="none" stroke="#8b949e" stroke-width="{_number(0.02 * strip)}"/>',
        "</g>",
        *_scale_bar(window, strip, ratio),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def path_data(polygon: Polygon) -> str:
    """Return the path of a polygon: one closed subpath a ring."""
    return "".join(_ring(np.asarray(ring.coords)[:-1]) for ring in (polygon.exterior, *polygon.interiors))


def paper_ratio(window: Window) -> float:
    """Return the round number N of a scale 1:N at which the window fits a page."""
    return _round_up(max(window.width, window.height) / LARGEST_SIDE)


def _ring(xy: NDArray[np.float64]) -> str:
    corners = "L".join(f"{_number(x)} {_number(y)}" for x, y in xy.tolist())
    return f"M{corners}Z"


def _scale_bar(window: Window, strip: float, ratio: float) -> Iterator[str]:
    """Yield a bar of a round length of at most a quarter of the width, and its words."""
    length = _round_up(window.width / 10.0)
    x, y = window.x_min, -window.y_min + 0.5 * strip
    end = x + length
    ends = f"M{_number(x)} {_number(y - 0.1 * strip)}V{_number(y)}H{_number(end)}V{_number(y - 0.1 * strip)}"
    style = f'fill="none" stroke="#1f2328" stroke-width="{_number(0.03 * strip)}"'
    place = f'x="{_number(end + 0.3 * strip)}" y="{_number(y)}"'
    yield '<g id="scale">'
    yield f'<path d="{ends}" {style}/>'
    yield f'<text {place} font-family="sans-serif" font-size="{_number(0.4 * strip)}">{length:g} m, 1:{ratio:g}</text>'
    yield "</g>"


def _round_up(value: float) -> float:
    """Return the least of 1, 2, 5, 10 ... times a power of ten that is not below `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-9))


def _number(value: float) -> str:
    """Return a number without trailing zeros, never -0."""
    return np.format_float_positional(round(value, DECIMALS) + 0.0, trim="-")
