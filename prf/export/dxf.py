"""The occupied area as DXF: closed polylines in metres, for CAD."""

from __future__ import annotations

import io

from shapely import MultiPolygon

from prf.export.extras import require
from prf.window import Window

VERSION = "R2010"
"""The first whose text is UTF-8 and that every CAD program in use reads."""
OCCUPIED, OUTLINE = "OCCUPIED", "OUTLINE"
BLACK_OR_WHITE, GREY = 7, 8
"""Numbers of the AutoCAD colour index."""


def dxf_text(area: MultiPolygon, window: Window, title: str) -> str:
    """Return the text of a DXF file.

    Parameters
    ----------
    area : shapely.MultiPolygon
        The occupied area in metres. Each ring, holes too, is a closed polyline on the layer ``OCCUPIED``; outer
        rings run counter-clockwise and holes clockwise.
    window : Window
        A closed polyline on the layer ``OUTLINE``.
    title : str
        Stands in the drawing's properties.

    Raises
    ------
    UsageError
        If ezdxf is not installed.
    """
    ezdxf = require("ezdxf", "dxf")
    document = ezdxf.new(VERSION, units=ezdxf.units.M)
    document.header["$MEASUREMENT"] = 1  # metric line types
    document.header.custom_vars.append("Title", title)
    document.layers.add(OCCUPIED, color=BLACK_OR_WHITE)
    document.layers.add(OUTLINE, color=GREY)
    space = document.modelspace()
    for polygon in area.geoms:
        for ring in (polygon.exterior, *polygon.interiors):
            space.add_lwpolyline(list(ring.coords)[:-1], format="xy", close=True, dxfattribs={"layer": OCCUPIED})
    space.add_lwpolyline(_corners(window), format="xy", close=True, dxfattribs={"layer": OUTLINE})
    document.set_modelspace_vport(height=1.1 * max(window.width, window.height), center=window.centre)
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def _corners(window: Window) -> list[tuple[float, float]]:
    x0, y0, x1, y1 = window
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
