"""The points that a segmentation looks at first: their neighbours and normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.cells import LEVELS
from mapq.kernels.growing import cut_gaps
from mapq.kernels.normals import estimate_normals
from mapq.kernels.robust import robust_normals
from mapq.segment.parameters import Parameters
from mapq.segment.points import Points
from mapq.segment.scale import TURNS, WIDE, neighbours_of, representatives

THICK = 1.5
"""Times the noise: a neighbourhood that is thicker holds more than one surface. One plane is so by chance in 1 of 500."""
BAND = 2.5
"""Times the noise: what a robust plane counts as near."""
MIN_SHARE = 0.35
"""Of a wide neighbourhood that must lie on a robust plane. Two copies of a wall have half each; in the crown of a tree
the best plane reaches a third by luck."""


class Core(NamedTuple):
    """Points with what region growing needs to know of them.

    Attributes
    ----------
    xyz : (c, 3) float64
    index : (c,) int64
        Their places among all points.
    neighbours : (c, k) int32
        Nearest first, none farther than the gap; -1 fills up.
    normal : (c, 3) float32
        nan where the neighbourhood shows no plane.
    variance : (c,) float32
        Across that plane, in square metres.
    n_thick : int
        Points whose normal is a robust one.
    """

    xyz: NDArray[np.float64]
    index: NDArray[np.int64]
    neighbours: NDArray[np.int32]
    normal: NDArray[np.float32]
    variance: NDArray[np.float32]
    n_thick: int


def make_core(points: Points, chosen: Parameters) -> Core:
    """Return the representatives at the chosen level with their neighbours and normals."""
    index = representatives(points, chosen.level)
    whole = chosen.level > LEVELS
    xyz, code = (points.xyz, points.code) if whole else (points.xyz[index], points.code[index])
    everyone = np.ones(len(xyz), bool)
    neighbours, _ = neighbours_of(xyz, code, points.frame, everyone, chosen.neighbours)
    normal, spread = np.empty((len(xyz), 3), np.float32), np.empty((len(xyz), 3), np.float32)
    estimate_normals(xyz, np.arange(len(xyz)), neighbours, normal, spread)
    thick = _is_thick(spread, chosen)
    variance = spread[:, 0].copy()
    if thick.any():
        wide, _ = neighbours_of(xyz, code, points.frame, thick, max(WIDE, chosen.neighbours))
        band = max(BAND * chosen.noise, BAND / 3.0 * chosen.max_distance)
        robust_normals(xyz, np.flatnonzero(thick), wide, TURNS, band, MIN_SHARE, normal, variance)
    rough = variance > chosen.max_variation * (variance + spread[:, 1] + spread[:, 2])
    normal[rough] = np.nan
    cut_gaps(xyz, neighbours, chosen.max_gap)
    return Core(xyz, index, neighbours, normal, variance, int(np.count_nonzero(thick)))


def _is_thick(spread: NDArray[np.float32], chosen: Parameters) -> NDArray[np.bool_]:
    """Return whose neighbourhoods (c,) are thicker than noise alone makes them."""
    unbiased = (chosen.neighbours + 1) / max(chosen.neighbours - 2, 1)
    limit = THICK * max(chosen.noise, chosen.max_distance / 6.0)
    return np.asarray(spread[:, 0] * unbiased > limit * limit)
