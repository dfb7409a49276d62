"""The points that a segmentation looks at first: their neighbours and normals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.normals import estimate_normals, robust_normals
from mapq.kernels.planes import Surface
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import Points
from mapq.segmentation.sample import TURNS, neighbours_of
from mapq.segmentation.scale import representatives

THICK = 1.5
"""Times the noise: a thicker neighbourhood holds more than one surface. One plane looks so in 1 place of 500."""
BAND = 2.5
"""Times the noise: what a robust plane counts as near."""
WIDE = 28
"""Points about a point when half of them may belong to another surface."""
MIN_SHARE = 0.3
"""Of a wide neighbourhood that must lie on a robust plane. Two copies of a wall have half each; in the crown of a tree
the best plane reaches a third by luck."""


class Core(NamedTuple):
    """Points with what region growing needs to know of them."""

    xyz: NDArray[np.float64]  # (c, 3)
    place: NDArray[np.int64]  # (c,) their places among all points
    neighbours: NDArray[np.int32]  # (c, k) nearest first, none farther than the gap; -1 fills up
    normal: NDArray[np.float32]  # (c, 3) nan where the neighbourhood shows no plane
    variance: NDArray[np.float32]  # (c,) across that plane, in square metres
    # (c,) whose neighbourhood holds more than one surface, so that the normal is that of the best one or of none
    thick: NDArray[np.bool_]

    @property
    def surface(self) -> Surface:
        """The points as the kernels take them."""
        return Surface(self.xyz, self.neighbours, self.normal)


def make_core(points: Points, chosen: Parameters) -> Core:
    """Return the representatives at the chosen level with their neighbours and normals."""
    place, xyz, code = representatives(points, chosen.level)
    everyone = np.ones(len(xyz), bool)
    neighbours = neighbours_of(xyz, code, points.frame, everyone, chosen.neighbours, chosen.max_gap)
    normal, spread = np.empty((len(xyz), 3), np.float32), np.empty((len(xyz), 3), np.float32)
    estimate_normals(xyz, np.arange(len(xyz)), neighbours, normal, spread)
    thick = _is_thick(spread, chosen)
    variance = spread[:, 0].copy()
    if thick.any():
        band, size = BAND / 3.0 * chosen.max_distance, max(WIDE, 2 * chosen.neighbours)
        robust_normals(xyz, thick, neighbours, size, TURNS, band, MIN_SHARE, normal, variance)
    rough = variance > chosen.max_variation * (variance + spread[:, 1] + spread[:, 2])
    normal[rough] = np.nan
    return Core(xyz, place, neighbours, normal, variance, thick)


def _is_thick(spread: NDArray[np.float32], chosen: Parameters) -> NDArray[np.bool_]:
    """Return whose neighbourhoods (c,) are thicker than noise alone makes them."""
    unbiased = (chosen.neighbours + 1) / max(chosen.neighbours - 2, 1)
    limit = THICK * max(chosen.noise, chosen.max_distance / 6.0)
    return np.asarray(spread[:, 0] * unbiased > limit * limit)


def sure_normals(core: Core) -> NDArray[np.float32]:
    """Return the normals (c, 3) without those of thick neighbourhoods: nan."""
    return np.where(core.thick[:, None], np.float32(np.nan), core.normal)
