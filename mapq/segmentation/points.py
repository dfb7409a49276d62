"""The points of a cloud in an order that is not that of the file: along the Morton curve, each once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.kernels.cells import LEVELS, find_bounds, first_levels, number_cells

FAR = 100.0
"""Times the extent of the middle 98 % of the points: farther out is left out where cells are too coarse otherwise."""
COUNTED_LEVEL = 8
"""Its cells are counted by a table of 16 MB; finer ones are foreseen from it, as on a surface: a quarter a level."""
BEST_FILL = 8.0
"""Points a cell at which the search for neighbours is fastest; it costs a quarter more at worst."""
CROWDED = 0.2
"""Share of points that share a finest cell with another place, from which on cells are too coarse."""


class Points(NamedTuple):
    """Distinct points, sorted."""

    xyz: NDArray[np.float64]  # (u, 3) along the Morton curve, ties by x, then y, then z
    code: NDArray[np.uint64]  # (u,) number on the curve
    frame: NDArray[np.float64]  # (4,) corner and side of the root cell
    first_level: NDArray[np.int8]  # (u,) see :func:`mapq.kernels.cells.first_levels`
    number: NDArray[np.int32]  # (n,) for each point of the cloud its place in `xyz`, -1 if it was left out
    n_not_finite: int  # left out for a missing coordinate; for lying absurdly far from all others
    n_far: int

    def multiplicity(self) -> NDArray[np.int64]:
        """Return how many points (u,) of the cloud share each place."""
        return np.bincount(self.number[self.number >= 0], minlength=len(self.xyz))


def sort_points(cloud: PointCloud) -> Points:
    """Return the distinct finite points of a cloud in canonical order.

    The finest cells are the extent / 2^21 wide. Where single absurd points make that so much that cells hold many
    places, they are left out.
    """
    finite = cloud.finite()
    points = _sorted(cloud, np.flatnonzero(finite), finite)
    crowded = np.count_nonzero(points.first_level > LEVELS) > CROWDED * len(points.xyz)
    near = finite & ~_far(cloud.xyz, finite) if crowded else finite
    return points if near.sum() == finite.sum() else _sorted(cloud, np.flatnonzero(near), finite)


def _sorted(cloud: PointCloud, kept: NDArray[np.int64], finite: NDArray[np.bool_]) -> Points:
    """Return the points of an index, sorted."""
    xyz = cloud.xyz if len(kept) == len(cloud) else cloud.xyz[kept]
    low, high = find_bounds(xyz) if len(xyz) else np.zeros((2, 3))
    side = float((high - low).max())
    frame = np.append(low, _root_side(xyz, low, side) if side > 0.0 else 1.0)
    points = sort_in_frame(xyz, frame)
    number = points.number
    if len(kept) < len(cloud):
        number = np.full(len(cloud), -1, np.int32)
        number[kept] = points.number
    n_finite = int(np.count_nonzero(finite))
    return points._replace(number=number, n_not_finite=len(cloud) - n_finite, n_far=n_finite - len(kept))


def sort_in_frame(xyz: NDArray[np.float64], frame: NDArray[np.float64]) -> Points:
    """Return the distinct ones of finite points (n, 3) in the canonical order of an octree with a given frame (4,)."""
    code = number_cells(xyz, frame[:3].copy(), float(frame[3]))
    order = _order(xyz, code)
    ordered, code = xyz.take(order, axis=0), code[order]
    new = np.ones(len(code), bool)
    new[1:] = code[1:] != code[:-1]
    tied = np.flatnonzero(~new)
    new[tied] = (ordered[tied] != ordered[tied - 1]).any(axis=1)
    number = np.empty(len(code), np.int32)
    number[order] = np.cumsum(new, dtype=np.int32) - 1
    if not new.all():
        ordered, code = ordered[new], code[new]
    return Points(ordered, code, frame, first_levels(code), number, 0, 0)


def _root_side(xyz: NDArray[np.float64], low: NDArray[np.float64], extent: float) -> float:
    """Return the side of the root, from the extent to twice that, at which cells of some level hold `BEST_FILL`."""
    shift = np.uint64(3 * (LEVELS - COUNTED_LEVEL))
    filled = np.zeros(8**COUNTED_LEVEL, bool)
    filled[number_cells(xyz, low, extent) >> shift] = True
    fill = len(xyz) / np.count_nonzero(filled)
    halvings = 0.5 * np.log2(fill / BEST_FILL)
    return float(extent * 2.0 ** (np.ceil(halvings) - halvings))


def _far(xyz: NDArray[np.float64], finite: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points (n,) lie far out from the middle ones."""
    low, high = np.quantile(xyz[finite], (0.01, 0.99), axis=0)
    reach = FAR * float((high - low).max())
    if reach == 0.0:
        return np.zeros(len(xyz), bool)
    with np.errstate(invalid="ignore"):
        return np.asarray(((xyz < low - reach) | (xyz > high + reach)).any(axis=1))


def _order(xyz: NDArray[np.float64], code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the order (n,) by code, then by coordinates."""
    order = np.argsort(code)
    equal = np.zeros(len(code) + 1, bool)
    ahead = code[order]
    equal[1:-1] = ahead[1:] == ahead[:-1]
    tied = np.flatnonzero(equal[1:] | equal[:-1])
    among = order[tied]
    order[tied] = among[np.lexsort((*xyz[among].T[::-1], code[among]))]
    return order
