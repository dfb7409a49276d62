"""What may be exported as known: cells that readings saw, and on request the ground near them."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from prf.coloring import from_polygons, occupied_polygons
from prf.export.source import Map
from prf.run import PosteriorImage
from prf.shell.errors import InputError

Bools = NDArray[np.bool_]

WALL = 0.5
"""Metres beyond seen cells up to which polygons of occupied ground are kept: walls are seen from one side."""
SEAM = 1e-6
"""Metres by which known ground is enlarged: parts of it that touch at a corner grow together."""


def known_cells(image: PosteriorImage, extrapolate: float) -> Bools:
    """Return which cells (ny, nx) lie within `extrapolate` metres, centre to centre, of one that a reading saw."""
    if extrapolate == 0.0 or image.seen.all() or not image.seen.any():
        return image.seen
    distance = ndimage.distance_transform_edt(~image.seen, sampling=image.resolution)
    return np.asarray(distance <= extrapolate)


def cut_to_known(found: Map, image: PosteriorImage | None, extrapolate: float) -> Map:
    """Return a map without the occupied ground that no reading came near (:data:`WALL`).

    Parameters
    ----------
    found : Map
    image : PosteriorImage or None
        Of the run that the map is of; None: nothing is cut off.
    extrapolate : float
        Metres beyond seen cells that count as known.
    """
    if image is None or image.seen.all():
        return found
    area = occupied_polygons(found.coloring)
    ground = known_ground(image, max(extrapolate, WALL))
    parts = [part for part in area.geoms if shapely.intersects(part, ground)]
    near = shapely.MultiPolygon(parts)
    for region in (shapely.intersection(near, ground), near):
        polygons = [part for part in shapely.get_parts(region) if shapely.get_dimensions(part) == 2]
        try:
            coloring = from_polygons(shapely.MultiPolygon(polygons), found.coloring.window)
        except InputError:  # the cut made parts touch at a point
            continue
        if coloring.n_edges > 0:
            return found._replace(coloring=coloring)
    return found._replace(coloring=type(found.coloring).empty(found.coloring.window))


def known_ground(image: PosteriorImage, extrapolate: float) -> BaseGeometry:
    """Return the ground of the cells that :func:`known_cells` names."""
    row, column = np.nonzero(known_cells(image, extrapolate))
    low = image.origin + image.resolution * np.column_stack([column, row])
    high = low + image.resolution
    boxes = shapely.box(*(low - SEAM).T, *(high + SEAM).T)
    ground: BaseGeometry = shapely.union_all(boxes)
    return ground
