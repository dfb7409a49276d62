"""The points of a cloud in an order that does not depend on the order of the file: along the Morton curve, each once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.kernels.cells import first_levels, number_cells

FAR = 100.0
"""Times the extent of the middle 98 % of the points: what lies farther out would make all cells coarse."""


class Points(NamedTuple):
    """Distinct points, sorted.

    Attributes
    ----------
    xyz : (u, 3) float64
        Along the Morton curve, ties by x, then y, then z.
    code : (u,) uint64
        Number on the curve.
    frame : (4,) float64
        Corner and side of the root cell.
    first_level : (u,) int8
        See :func:`mapq.kernels.cells.first_levels`.
    number : (n,) int32
        For each point of the cloud its place in `xyz`, -1 if it was left out.
    n_not_finite, n_far : int
        Left out for a missing coordinate; for lying absurdly far from all others.
    """

    xyz: NDArray[np.float64]
    code: NDArray[np.uint64]
    frame: NDArray[np.float64]
    first_level: NDArray[np.int8]
    number: NDArray[np.int32]
    n_not_finite: int
    n_far: int

    def multiplicity(self) -> NDArray[np.int64]:
        """Return how many points (u,) of the cloud share each place."""
        return np.bincount(self.number[self.number >= 0], minlength=len(self.xyz))


def sort_points(cloud: PointCloud) -> Points:
    """Return the distinct finite points of a cloud in canonical order."""
    finite = cloud.finite()
    kept = np.flatnonzero(finite & ~_far(cloud.xyz, finite))
    xyz = cloud.xyz[kept]
    low = xyz.min(axis=0) if len(xyz) else np.zeros(3)
    side = float((xyz.max(axis=0) - low).max()) if len(xyz) else 0.0
    frame = np.append(low, side if side > 0.0 else 1.0)
    code = number_cells(xyz, low, float(frame[3]))
    order = _order(xyz, code)
    xyz, code = xyz[order], code[order]
    new = np.ones(len(xyz), bool)
    new[1:] = (xyz[1:] != xyz[:-1]).any(axis=1)
    number = np.full(len(cloud), -1, np.int32)
    number[kept[order]] = np.cumsum(new) - 1
    if not new.all():
        xyz, code = xyz[new], code[new]
    n_finite = int(np.count_nonzero(finite))
    return Points(xyz, code, frame, first_levels(code), number, len(cloud) - n_finite, n_finite - len(kept))


def _far(xyz: NDArray[np.float64], finite: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points (n,) lie so far out that the cells of all others would become coarse."""
    if not finite.any():
        return ~finite
    low, high = np.quantile(xyz[finite], (0.01, 0.99), axis=0)
    reach = FAR * float((high - low).max())
    if reach == 0.0:
        return np.zeros(len(xyz), bool)
    with np.errstate(invalid="ignore"):
        return np.asarray(((xyz < low - reach) | (xyz > high + reach)).any(axis=1))


def _order(xyz: NDArray[np.float64], code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the order (n,) by code, then by coordinates."""
    order = np.argsort(code, kind="stable")
    equal = np.zeros(len(code) + 1, bool)
    equal[1:-1] = code[order[1:]] == code[order[:-1]]
    tied = np.flatnonzero(equal[1:] | equal[:-1])
    among = order[tied]
    order[tied] = among[np.lexsort((*xyz[among].T[::-1], code[among]))]
    return order
