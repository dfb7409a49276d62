"""The occupied area as a drawing: SVG to a round scale with a bar of its length, and DXF in metres for CAD."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from prf.model.walls import N_WALL, corners_of
from prf.model.window import Window
from prf.output.export.outlines import LAYERS, OCCUPIED, Outline
from prf.results.plan import Plan

MAX_SIDE = 0.4  # metres of paper: the longer side of an A3 page with margins
DECIMALS = 4  # a tenth of a millimetre in the world
STRIP = 0.06  # height of the strip with the scale bar below the map, as a share of the window's longer side
VERSION = "R2010"  # the first whose text is UTF-8 and that every CAD program in use reads
OUTLINE = "OUTLINE"
WALLS, CENTRE_LINES, DOORS = "WALLS", "CENTRE_LINES", "DOORS"
AREA_LAYERS = {
    OCCUPIED: (7, "CONTINUOUS", "outlines of one map"),
    LAYERS[0][1]: (7, "CONTINUOUS", "outlines that 90 % of the draws have or more"),
    LAYERS[1][1]: (30, "CONTINUOUS", "outlines that 50 to 90 % of the draws have"),
    LAYERS[2][1]: (1, "DASHED", "outlines that fewer than half of the draws have"),
    OUTLINE: (8, "CONTINUOUS", "window of the map"),
}
PLAN_LAYERS = {
    WALLS: (7, "CONTINUOUS", "walls with their thickness"),
    CENTRE_LINES: (1, "CONTINUOUS", "centre lines of walls"),
    DOORS: (3, "CONTINUOUS", "doors, from jamb to jamb"),
    OUTLINE: AREA_LAYERS[OUTLINE],
}
"""Colour (AutoCAD index: 7 black or white, 30 orange, 1 red, 3 green, 8 grey), line type and words of each layer."""


def svg_text(area: MultiPolygon, window: Window, title: str) -> str:
    """Return the text of an SVG file.

    Parameters
    ----------
    area : shapely.MultiPolygon
        The occupied area in metres.
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
    return _round_up(max(window.width, window.height) / MAX_SIDE)


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


def dxf_text(lines: Sequence[Outline], window: Window, title: str) -> str:
    """Return the text of a DXF file.

    `lines`: outlines of the occupied area as polylines on their layers (:data:`prf.output.export.outlines.LAYERS`);
    outer rings run counter-clockwise and holes clockwise. `window`: a closed polyline on the layer ``OUTLINE``.
    `title`: for the drawing's properties.
    """
    return _drawing(lines, AREA_LAYERS, window, title)


def plan_dxf(plan: Plan, window: Window, title: str) -> str:
    """Return the text of a DXF file of a plan.

    Each wall is a closed polyline on the layer ``WALLS`` and its centre line one on ``CENTRE_LINES``, each door a line
    between its jambs on ``DOORS``; the window as in :func:`dxf_text`.
    """
    walls = np.array([[*wall.ends.ravel(), wall.thickness] for wall in plan.walls]).reshape(-1, N_WALL)
    lines = [Outline(xy, True, WALLS) for xy in corners_of(walls)]
    lines += [Outline(wall.ends, False, CENTRE_LINES) for wall in plan.walls]
    lines += [Outline(door.ends, False, DOORS) for door in plan.doors]
    return _drawing(lines, PLAN_LAYERS, window, title)


def _drawing(lines: Sequence[Outline], layers: Mapping[str, tuple[int, str, str]], window: Window, title: str) -> str:
    from ezdxf import units  # noqa: PLC0415 - a third of a second, for DXF alone
    from ezdxf.filemanagement import new  # noqa: PLC0415

    document = new(VERSION, setup=["linetypes"], units=units.M)
    document.header["$MEASUREMENT"] = 1  # metric line types
    document.header.custom_vars.append("Title", title)
    for name, (colour, line_type, words) in layers.items():
        document.layers.add(name, color=colour, linetype=line_type).description = words
    space = document.modelspace()
    for line in lines:
        attributes = {"layer": line.layer}
        space.add_lwpolyline(line.xy.tolist(), format="xy", close=line.is_closed, dxfattribs=attributes)
    space.add_lwpolyline(_corners(window), format="xy", close=True, dxfattribs={"layer": OUTLINE})
    document.set_modelspace_vport(height=1.1 * max(window.width, window.height), center=window.centre)
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def _corners(window: Window) -> list[tuple[float, float]]:
    x0, y0, x1, y1 = window
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
