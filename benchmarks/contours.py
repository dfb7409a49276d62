"""Polygons from an occupancy grid, as maps are vectorised in practice: likely cells joined, corners thinned."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from prf.results.occupancy import OccupancyGrid

THRESHOLD = 0.35
"""Cells that some beam ended in and that are at least so probably occupied are walls; 0.5 loses thin ones."""
GAP = 0.1
"""Metres on either side of a gap that is closed: walls of single cells become one polygon."""
TOLERANCE = 0.075
"""Metres by which a thinned contour may leave cells of 0.1 m (Douglas and Peucker): it straightens a staircase of
cells, and a wall of one cell stays as thick as it is."""


def contour_polygons(grid: OccupancyGrid) -> BaseGeometry:
    """Return the polygons of the walls in a grid; what no beam reached is no wall."""
    rows, columns = np.nonzero((grid.occupancy >= THRESHOLD) & (grid.hits > 0))
    low = grid.origin + grid.resolution * np.column_stack([columns, rows])
    high = low + grid.resolution
    cells = shapely.union_all(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
    # A little less is taken back than was added, so that cells which touch at a corner hold together.
    closed = shapely.buffer(shapely.buffer(cells, GAP, join_style="mitre"), 0.001 - GAP, join_style="mitre")
    corners = shapely.simplify(closed, 0.0)  # rings then begin at a corner, which stays
    thinned = shapely.make_valid(shapely.simplify(corners, TOLERANCE))
    return shapely.multipolygons([part for part in shapely.get_parts(thinned) if part.geom_type == "Polygon"])


def write_contours(grid: OccupancyGrid, target: Path) -> int:
    """Write the polygons as a map that `prf score` reads; return the number of their corners."""
    found = contour_polygons(grid)
    geometry = shapely.geometry.mapping(found)
    feature = {"type": "Feature", "geometry": geometry, "properties": {"window": list(grid.window)}}
    target.write_text(json.dumps(feature))
    rings = shapely.get_rings(shapely.get_parts(found))
    return int(sum(shapely.get_num_coordinates(rings) - 1))
