"""Occupancy grids, the baseline: cells that know nothing of one another (paper, section 1.2)."""

from prf.results.occupancy.build import BuiltGrid, build_grid, grid_sources
from prf.results.occupancy.grid import (
    SCHEMA,
    OccupancyGrid,
    is_grid,
    occupied_probability,
    path_free,
    read_grid,
    write_grid,
)

__all__ = [
    "SCHEMA",
    "BuiltGrid",
    "OccupancyGrid",
    "build_grid",
    "grid_sources",
    "is_grid",
    "occupied_probability",
    "path_free",
    "read_grid",
    "write_grid",
]
