"""Finished maps as beams and sonars meet them: first edges on rays, and edges with their vertices indexed for cones."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.kernels import constants as c
from prf.kernels.readings.sonar_features import N_FEATURE
from prf.kernels.score.sonar import Scene, list_features
from prf.kernels.state.cell_lists import first_segments, list_segments
from prf.kernels.state.grid import Grid, make_grid, most_cells
from prf.model.coloring import Coloring
from prf.model.coloring.polygons import turning_corners
from prf.model.ranges import make_sight
from prf.model.window import INTERIOR, Window

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

REL_TOL = 1e-9  # share of a window's extent within which a vertex lies on its border
FLAT = 1e-6  # metres by which a vertex must leave the line through its neighbours, else it is not a corner
CELLS_PER_EDGE = 2.0  # cells of the index of edges: fewer make lists longer, more make walks longer
MIN_CELLS, MAX_CELLS = 100.0, 250_000.0


def scene_of_coloring(coloring: Coloring, reach: float) -> Scene:
    """Return a coloring as cones of this reach (metres) look at it; its interior vertices are corners."""
    ends = coloring.edges.reshape(-1, 2)
    corners = np.where(coloring.side[ends] == INTERIOR, ends, c.NONE)
    return make_scene(coloring.segments(), corners, coloring.window, reach)


def scene_of_region(region: BaseGeometry, window: Window | None, origin: Floats, reach: float) -> Scene:
    """Return occupied area as cones at `origin` (n, 2) of this reach (metres) look at it.

    `region`: polygons; every vertex at which the outline turns is a corner. `window`: what lies along its border is no
    wall. None: everywhere.
    """
    segments, corners = outline(region, window)
    return make_scene(segments, corners, window or enclosing_window(origin, reach, region), reach)


def make_scene(segments: Floats, corners: NDArray[np.integer], window: Window, reach: float) -> Scene:
    """Return edges (n, 4), and the vertices (n, 2) at their ends (NONE: no corner), indexed by cell."""
    grid = index_grid(window, len(segments))
    across = 2 * math.ceil(reach / grid.cell) + 3
    room = min(across, grid.nx) * min(across, grid.ny)
    return Scene(
        edges=list_segments(grid, np.asarray(segments, np.float64).reshape(-1, 4)),
        corners=np.ascontiguousarray(corners, dtype=np.int32).reshape(-1, 2),
        marks=np.zeros(len(segments), np.int64),
        mark=np.zeros(1, np.int64),
        cells=np.empty(room, np.int32),
        near=np.empty(room),
        sight=make_sight(len(segments) + 1),
    )


def outline(region: BaseGeometry, window: Window | None) -> tuple[Floats, Ints]:
    """Return the sides of all polygons, (n, 4), and numbers of the vertices at their ends, (n, 2).

    Sides along the window's border are left out, and vertices on it are NONE.
    """
    rings = [_without_flat(shapely.get_coordinates(ring)[:-1]) for ring in shapely.get_rings(shapely.get_parts(region))]
    if not rings:
        return np.empty((0, 4)), np.empty((0, 2), np.int32)
    sides = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    _, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    corners = number.reshape(-1, 2).astype(np.int32)
    if window is not None:
        tolerance = REL_TOL * max(window.width, window.height)
        bounds = np.array([window[:2], window[2:]])
        at_border = np.abs(sides[:, :, None, :] - bounds) <= tolerance  # side, end, lower or upper, x or y
        corners[at_border.any(axis=(2, 3))] = c.NONE
        inner = ~at_border.all(axis=1).any(axis=(1, 2))
        sides, corners = sides[inner], corners[inner]
    return np.ascontiguousarray(sides.reshape(-1, 4)), corners


def _without_flat(ring: Floats) -> Floats:
    """Return the vertices (n, 2) of a ring at which it turns."""
    kept = turning_corners(ring, FLAT)
    return kept if len(kept) >= 3 else ring


def enclosing_window(origin: Floats, reach: float, region: BaseGeometry) -> Window:
    """Return a box round everything within `reach` metres of the sensors, and all polygons."""
    xy = np.vstack([origin - reach, origin + reach, shapely.get_coordinates(region)])
    return Window(*(xy.min(axis=0) - 1.0).tolist(), *(xy.max(axis=0) + 1.0).tolist())


def features_seen(scene: Scene, pose: Floats, reach: float) -> tuple[NDArray[np.int64], Floats]:
    """Return the features in each cone, nearest first.

    `pose` (n, N_POSE): from :func:`prf.model.ranges.make_poses`. `reach`: maximum range, metres. Returns `start`
    (n + 1,), of which rows `start[i]` to before `start[i + 1]` belong to cone i, and features (n_features, N_FEATURE),
    columns as in ``prf.kernels.readings.sonar_features``.
    """
    start = np.zeros(len(pose) + 1, np.int64)
    feature = np.empty((0, N_FEATURE))
    needed = list_features(scene, reach, pose, start, feature)
    feature = np.empty((needed, N_FEATURE))
    list_features(scene, reach, pose, start, feature)
    return start, feature


def first_edges(rays: Floats, segments: Floats, window: Window) -> Floats:
    """Return the distance (n,) at which each ray first meets a segment, inf for none within its reach.

    `rays` (n, 5): origin, unit direction and reach; all of them inside the window. `segments` (n_edges, 4).
    """
    return first_hits(rays, segments, window)[0]


def first_hits(rays: Floats, segments: Floats, window: Window) -> tuple[Floats, Ints]:
    """Return the distances of :func:`first_edges`, and the number (n,) of the segment, NONE for none."""
    grid = index_grid(window, len(segments))
    distance, found = np.empty(len(rays)), np.empty(len(rays), np.int32)
    no_tile, path = np.full(max(len(rays), len(segments)), c.NONE, np.int32), np.empty(most_cells(grid), np.int32)
    limit = np.ascontiguousarray(rays[:, c.MAX_DISTANCE])
    first_segments(list_segments(grid, segments), no_tile, rays, no_tile, limit, path, found, distance)
    return np.where(found == c.NONE, np.inf, distance), found


def index_grid(window: Window, n_edges: int) -> Grid:
    """Return the cells of an index of this many edges."""
    n_cells = min(max(CELLS_PER_EDGE * n_edges, MIN_CELLS), MAX_CELLS)
    return make_grid(*window, math.sqrt(window.area / n_cells))
