"""Joint and separate entropy of two scans, after the description of CorAl (Adolfsson et al. 2021): a rival's features.

Written from the description, not from its code, and without its rejection of outliers. Points are thinned to one a cell
of `THIN`, and so many of each scan are asked.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from mapq.cloud import PointCloud
from mapq.posed.merge import cell_keys

THIN = 0.1
"""Metres."""
ASKED = 1500
"""Points of each scan."""
RADIUS_BY_RANGE, RADII = 0.035, (0.5, 3.0)
"""Five times the sine of 0.4 degrees, the step of beams; and metres between which the radius stays."""
LEAST = 5
"""Points of either scan that a neighbourhood needs: else the scans do not overlap there."""
FLOOR = 1e-6
"""m² added to variances: planes without noise have none."""


def entropies(cloud: PointCloud) -> tuple[float, float]:
    """Return the mean joint and separate entropy, in nats, where the two scans of a map overlap; nan where nowhere."""
    scan = cloud.fields["scan"]
    parts = [_thinned(cloud, scan == number) for number in (0, 1)]
    trees = [KDTree(part[:, :3], balanced_tree=False) for part in parts]
    joint, separate = [], []
    for own, other in ((0, 1), (1, 0)):
        some = parts[own][:: max(1, len(parts[own]) // ASKED)]
        radius = np.clip(RADIUS_BY_RANGE * some[:, 3], *RADII)
        sums = [moments_of(trees[index], some[:, :3], radius) for index in (own, other)]
        overlap = (sums[0][:, 0] >= LEAST) & (sums[1][:, 0] >= LEAST)
        separate.append(entropy_of(sums[0][overlap]))
        joint.append(entropy_of((sums[0] + sums[1])[overlap]))
    both = np.concatenate(joint), np.concatenate(separate)
    return (float(both[0].mean()), float(both[1].mean())) if len(both[0]) else (float("nan"), float("nan"))


def _thinned(cloud: PointCloud, rows: np.ndarray) -> np.ndarray:
    """Return points of a scan with their ranges (n, 4), the first of each cell."""
    xyz = cloud.xyz[rows]
    ranges = np.linalg.norm(np.column_stack([cloud.fields[f"to_sensor_{axis}"][rows] for axis in "xyz"]), axis=1)
    first = np.sort(np.unique(cell_keys(xyz, THIN), return_index=True)[1])
    return np.column_stack([xyz, ranges])[first]


def moments_of(tree: KDTree, places: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return count, sums and sums of products (n, 13) of the neighbours of places, relative to these."""
    found = tree.query_ball_point(places, radius)
    counts = np.array([len(each) for each in found])
    rows = np.concatenate([np.asarray(each, np.int64) for each in found])
    group = np.repeat(np.arange(len(places)), counts)
    apart = np.asarray(tree.data)[rows] - places[group]
    products = (apart[:, :, None] * apart[:, None, :]).reshape(-1, 9)
    values = np.column_stack([np.ones(len(rows)), apart, products])
    return np.stack([np.bincount(group, column, len(places)) for column in values.T], axis=1)


def entropy_of(sums: np.ndarray) -> np.ndarray:
    """Return the entropies (n,) of the normal laws of neighbourhoods, given their moments (n, 13)."""
    mean = sums[:, 1:4] / sums[:, :1]
    covariance = (sums[:, 4:] / sums[:, :1]).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :]
    return np.asarray(0.5 * np.linalg.slogdet(2.0 * np.pi * np.e * (covariance + FLOOR * np.eye(3)))[1])
