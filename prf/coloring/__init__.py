"""Polygonal colorings: the discontinuity graph as arrays, its validity, its colours, its polygons, its files."""

from prf.coloring.graph import Coloring, Draws

__all__ = ["Coloring", "Draws"]
