"""Polygonal colorings: the discontinuity graph as arrays, its validity, its colours, its polygons, its files."""

from prf.model.coloring.geojson import feature_lines, from_feature, read_geojsonl, to_feature
from prf.model.coloring.graph import Coloring, Draws, black_areas, black_at, black_at_draws, count_black
from prf.model.coloring.polygons import check, from_polygons, occupied_polygons, oriented_polygons, violations
from prf.model.coloring.rectangles import outline_of_rectangles

__all__ = [
    "Coloring",
    "Draws",
    "black_areas",
    "black_at",
    "black_at_draws",
    "check",
    "count_black",
    "feature_lines",
    "from_feature",
    "from_polygons",
    "occupied_polygons",
    "oriented_polygons",
    "outline_of_rectangles",
    "read_geojsonl",
    "to_feature",
    "violations",
]
