"""One number for a whole map, as others publish it: mean map entropy and mean plane variance.

They show neither what is wrong nor where; they are here for comparison.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from mapq.cloud import PointCloud
from prf.shell.errors import UsageError

RADIUS = 0.5
"""Metres round a point whose neighbourhood is looked at (Droeschel, Stückler and Behnke 2014)."""
LEAST = 5
"""Points that a neighbourhood needs, the middle one included."""
SAMPLE = 4_000
"""Points that are sampled, at most: the error of the mean is then below a fiftieth of the spread."""
BATCH = 100
"""Points whose neighbours are held at once."""


class MapMetrics(NamedTuple):
    """Published whole-map numbers; lower is crisper, and maps of other density or scale cannot be compared."""

    # mean over points of ½ ln det(2 pi e Sigma), Sigma the covariance of the points within the radius; nats with
    # metres. nan where no neighbourhood is large enough.
    mean_map_entropy: float
    mean_plane_variance: float  # mean of the smallest eigenvalue of Sigma, m²; nan likewise
    radius: float  # metres
    n_points: int  # finite points, those that were sampled, and those of them with a neighbourhood that counts
    n_asked: int
    n_used: int


def map_metrics(cloud: PointCloud, radius: float = RADIUS) -> MapMetrics:
    """Return mean map entropy and mean plane variance of a cloud.

    Definitions of Droeschel, Stückler and Behnke 2014, "Local multi-resolution representation for 6D motion estimation
    and mapping with a continuously rotating 3D laser scanner", and Kornilova and Ferrer 2021, "Be your own benchmark:
    no-reference trajectory metric on registered point clouds". Neighbourhoods of fewer than `LEAST` points, and those
    in an exact plane, whose entropy is minus infinity, are left out of both means.

    `radius`: metres. Raises UsageError if the radius is no length.
    """
    if not 0.0 < radius < 1e6:
        raise UsageError(f"radius {radius:g} m: must be above 0.")
    xyz = cloud.xyz[cloud.finite()]
    xyz = xyz[np.lexsort(xyz.T)]
    sampled = np.unique(np.linspace(0, len(xyz) - 1, min(SAMPLE, len(xyz))).round().astype(np.int64))
    tree = KDTree(xyz, balanced_tree=False, compact_nodes=False) if len(xyz) else None
    entropy, variance = [np.zeros(0)], [np.zeros(0)]
    for first in range(0, len(sampled), BATCH):
        assert tree is not None
        found = tree.query_ball_point(xyz[sampled[first : first + BATCH]], radius, return_sorted=True)
        values = _neighbourhoods(xyz, found)
        entropy.append(values[:, 0])
        variance.append(values[:, 1])
    h, v = np.concatenate(entropy), np.concatenate(variance)
    means = (float(h.mean()), float(v.mean())) if len(h) else (float("nan"), float("nan"))
    return MapMetrics(*means, radius, len(xyz), len(sampled), len(h))


def _neighbourhoods(xyz: NDArray[np.float64], found: NDArray[np.object_]) -> NDArray[np.float64]:
    """Return entropy and smallest eigenvalue (k, 2) of those neighbourhoods that count."""
    found = found[[len(each) >= LEAST for each in found]]
    if len(found) == 0:
        return np.zeros((0, 2))
    counts = np.array([len(each) for each in found])
    start = np.concatenate([[0], np.cumsum(counts)[:-1]])
    points = xyz[np.concatenate(found).astype(np.int64)]
    group = np.repeat(np.arange(len(found)), counts)
    relative = points - (np.add.reduceat(points, start, axis=0) / counts[:, None])[group]
    products = relative[:, :, None] * relative[:, None, :]
    sigma = np.add.reduceat(products, start, axis=0) / (counts - 1)[:, None, None]
    eigenvalues = np.linalg.eigvalsh(sigma)
    solid = eigenvalues[:, 0] > 1e-12 * eigenvalues[:, 2]
    logs = np.log(2.0 * np.pi * np.e * eigenvalues[solid])
    return np.column_stack([0.5 * logs.sum(axis=1), eigenvalues[solid, 0]])
