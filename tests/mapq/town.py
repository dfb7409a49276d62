"""A map of any number of patches for tests of load: one yard of small walls, laid side by side.

The yard is drawn once, so a million patches take seconds to make. One wall stands there four times, so that there is
something to be found everywhere, and in as many regions as there are yards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.patches import Patches
from tests.mapq.factories import make_patches, wall

PITCH = 9.0
"""Metres from yard to yard: neighbours of a wall stand in the next yard too."""
ALONG, UP = np.linspace(-1.0, 1.0, 6), np.linspace(-0.75, 0.75, 4)
"""Metres: 24 points a wall."""
NOISE = 0.01
WALLS = (
    ((0.5, 0.5), (2.5, 0.5)),
    ((5.0, 0.5), (7.0, 0.8)),
    ((0.5, 3.5), (0.5, 5.5)),
    ((7.5, 6.0), (7.7, 8.0)),
    ((4.0, 4.0), (6.0, 4.0)),
    ((4.0, 4.3), (6.0, 4.35)),
    ((4.0, 4.6), (6.0, 4.6)),
    ((4.0, 4.9), (6.0, 4.95)),
)
"""Feet of the walls of a yard, from and to; the last four are one wall."""


def yard() -> Patches:
    """Return the walls of one yard."""
    rng = np.random.default_rng(3)
    u, v = (grid.ravel() for grid in np.meshgrid(ALONG, UP))
    drawn = [wall(start, end, 2.0) for start, end in WALLS]
    places = [np.column_stack([u, v, rng.normal(0.0, NOISE, len(u))]) for _ in drawn]
    points = [np.array(one.middle) + place @ one.axes for one, place in zip(drawn, places, strict=True)]
    return make_patches(points, [one.axes[2] for one in drawn])


def town(n_patches: int) -> Patches:
    """Return a square of yards with `n_patches` patches or a few more."""
    one = yard()
    n_yards = -(-n_patches // len(WALLS))
    side = int(np.ceil(np.sqrt(n_yards)))
    place = np.column_stack([np.arange(n_yards) % side, np.arange(n_yards) // side, np.zeros(n_yards)]) * PITCH

    def laid(rows: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ascontiguousarray((place[:, None, :] + rows).reshape(-1, 3))

    number = len(WALLS) * np.arange(n_yards, dtype=np.int32)[:, None] + one.patch
    cloud = PointCloud(laid(one.cloud.xyz), np.zeros(3))
    normal = np.tile(one.normal, (n_yards, 1))
    return Patches.unlabelled(cloud, number.ravel(), normal, laid(one.centroid), {}, {})
