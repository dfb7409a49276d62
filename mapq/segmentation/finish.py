"""From regions to patches: what is too small or too far from vertical goes, the rest is numbered, largest first."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.regions import PLANE_BITS, number_plane_cells
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import Points
from mapq.segmentation.regions import Fits, fit

WIDTH_IN_THICKNESS = 4.0
"""Standard deviations along the short side by those across: less is a slab of points, not a surface."""
CELL_IN_SPACING = 2.0
"""Side of the cells by which areas are counted: a cell on a surface holds four points, so few stay empty."""


class Kept(NamedTuple):
    """Patches among distinct points: number (u,), plane (m, 6) and the report's part on them."""

    patch: NDArray[np.int32]
    planes: NDArray[np.float64]
    report: dict[str, Any]


def keep_patches(points: Points, region: NDArray[np.int32], chosen: Parameters) -> Kept:
    """Return the regions that are patches, largest first (ties: by their first point), and what was dropped."""
    fits = fit(points.xyz, region)
    large = is_large(fits, chosen)
    upright = is_upright(fits.planes, chosen)
    copies = points.multiplicity()
    n_points = np.bincount(region[region >= 0], weights=copies[region >= 0], minlength=len(large)).astype(np.int64)
    order = number_regions(large & upright, n_points, _first_points(region, len(large)))
    number = np.full(len(large) + 1, -1, np.int32)
    number[order] = np.arange(len(order))
    areas = region_areas(points.xyz, region, fits, CELL_IN_SPACING * chosen.spacing)
    return Kept(number[region], fits.planes[order], report_of(fits, chosen, n_points, areas))


def number_regions(
    kept: NDArray[np.bool_], n_points: NDArray[np.int64], first: NDArray[np.int64] | NDArray[np.uint64]
) -> NDArray[np.int64]:
    """Return the regions that are kept (a mask) in the order of their numbers: largest first, ties by first point."""
    regions = np.flatnonzero(kept)
    return np.asarray(regions[np.lexsort((first[regions], -n_points[regions]))])


def report_of(
    fits: Fits, chosen: Parameters, n_points: NDArray[np.int64], areas: NDArray[np.float64]
) -> dict[str, Any]:
    """Return the report's part on regions (m): which are patches, and what was dropped."""
    large, upright = is_large(fits, chosen), is_upright(fits.planes, chosen)
    kept = large & upright
    return {
        "patches": int(np.count_nonzero(kept)),
        "points_in_patches": int(n_points[kept].sum()),
        "dropped_for_tilt": _tally(large & ~upright, n_points, areas),
        "dropped_as_small": _tally(~large & (fits.sums[:, 0] > 0), n_points, areas),
    }


def is_large(fits: Fits, chosen: Parameters) -> NDArray[np.bool_]:
    """Return which regions (m,) have points and width enough, and are no slabs."""
    thickness, side = np.sqrt(np.nan_to_num(fits.spread[:, 0])), np.sqrt(np.nan_to_num(fits.spread[:, 1]))
    wide = (np.sqrt(12.0) * side >= chosen.min_extent) & (side >= WIDTH_IN_THICKNESS * thickness)
    return np.asarray(wide & (fits.sums[:, 0] >= max(chosen.min_points, 3)))


def is_upright(planes: NDArray[np.float64], chosen: Parameters) -> NDArray[np.bool_]:
    """Return which planes (m,) are within the tilt allowed from vertical."""
    return np.asarray(~(tilt_of(planes, chosen) > chosen.max_tilt))


def tilt_of(planes: NDArray[np.float64], chosen: Parameters) -> NDArray[np.float64]:
    """Return the degrees (m,) by which planes are off vertical."""
    return np.asarray(np.degrees(np.arcsin(np.clip(np.abs(planes[:, :3] @ chosen.up), 0.0, 1.0))))


def region_areas(xyz: NDArray[np.float64], region: NDArray[np.int32], fits: Fits, cell: float) -> NDArray[np.float64]:
    """Return the area (m,) of each region in square metres: cells of its plane that hold a point."""
    key = np.empty(len(xyz), np.int64)
    number_plane_cells(xyz, region, fits.planes, cell, key)
    cells = np.sort(key[key >= 0])
    new = np.ones(len(cells), bool)
    new[1:] = cells[1:] != cells[:-1]
    n_cells = np.bincount(cells[new] >> PLANE_BITS, minlength=len(fits.planes))
    return np.asarray(n_cells * (cell * cell), np.float64)


def _first_points(region: NDArray[np.int32], n_regions: int) -> NDArray[np.int64]:
    first = np.full(n_regions, len(region), np.int64)
    members = np.flatnonzero(region >= 0)[::-1]
    first[region[members]] = members
    return first


def _tally(which: NDArray[np.bool_], n_points: NDArray[np.int64], areas: NDArray[np.float64]) -> dict[str, int | float]:
    return {
        "patches": int(np.count_nonzero(which)),
        "points": int(n_points[which].sum()),
        "area": float(areas[which].sum()),
    }
