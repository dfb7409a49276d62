"""The occupied area as a GeoJSON Feature, in the form of a run's map.geojson, so that prf reads it again."""

from __future__ import annotations

import shapely
from shapely import MultiPolygon

from prf.export.source import Map
from prf.run import map_feature, names
from prf.shell.jsonout import dump_object


def geojson_text(chosen: Map, area: MultiPolygon) -> str:
    """Return the text of a GeoJSON file.

    Parameters
    ----------
    chosen : Map
    area : shapely.MultiPolygon
        Its occupied area in metres. Coordinates are written to the last bit.
    """
    feature = {**map_feature(chosen.coloring, chosen.properties), "geometry": shapely.geometry.mapping(area)}
    return dump_object(names.SCHEMAS[names.MAP], feature) + "\n"
