"""The first edge that each of many rays meets."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels.grid import Grid, make_grid, most_cells
from prf.kernels.laser_score import trace_rays
from prf.window import Window

Floats = NDArray[np.float64]

CELLS_PER_EDGE = 2.0
"""Cells of the index of edges: fewer make lists longer, more make walks longer."""
LEAST_CELLS, MOST_CELLS = 100.0, 250_000.0


def first_edges(rays: Floats, segments: Floats, window: Window) -> Floats:
    """Return the distance (n,) at which each ray first meets a segment, inf for none within its reach.

    Parameters
    ----------
    rays : (n, 5) array
        Origin, unit direction and reach; all of them inside the window.
    segments : (n_edges, 4) array
    window : Window
    """
    grid = index_grid(window, len(segments))
    distance = np.empty(len(rays))
    trace_rays(grid, rays, np.ascontiguousarray(segments), np.empty(most_cells(grid), np.int32), distance)
    return distance


def index_grid(window: Window, n_edges: int) -> Grid:
    """Return the cells of an index of so many edges."""
    n_cells = min(max(CELLS_PER_EDGE * n_edges, LEAST_CELLS), MOST_CELLS)
    return make_grid(*window, math.sqrt(window.area / n_cells))
