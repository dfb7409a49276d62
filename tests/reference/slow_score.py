"""Scores in plain numpy and scipy, as docs/scores.md defines them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, stats

from prf.occupancy import OccupancyGrid

Floats = NDArray[np.float64]


def grid_density(
    grid: OccupancyGrid, origin: Floats, angle: float, readings: Floats, noise: float, outlier: float, limit: float
) -> tuple[Floats, float]:
    """Density of readings of one beam, and the mass of no return: a sum over bins, the blur by quadrature."""
    density = np.full(len(readings), outlier / limit)
    unmet, mass = 1.0, 0.0
    for near in np.arange(0.0, limit - 1e-9, 0.1):
        far = min(near + 0.1, limit)
        middle = 0.5 * (near + far)
        place = origin + middle * np.array([np.cos(angle), np.sin(angle)])
        column, row = np.floor((place - grid.origin) / grid.resolution).astype(int)
        known = 0 <= row < grid.occupancy.shape[0] and 0 <= column < grid.occupancy.shape[1]
        p = float(grid.occupancy[row, column]) if known else 0.5
        blur = [
            integrate.quad(lambda d, r=r: stats.norm.pdf(r, d, noise), near, far, points=(middle,))[0] for r in readings
        ]
        total = integrate.quad(lambda d: stats.norm.cdf(d / noise), near, far)[0]
        beyond = integrate.quad(lambda d: stats.norm.cdf((d - limit) / noise), near, far)[0]
        density += (1.0 - outlier) * p * unmet * np.array(blur) / total
        mass += (1.0 - outlier) * p * unmet * beyond / total
        unmet *= 1.0 - p
    return density, mass + (1.0 - outlier) * unmet


def pair_count_area(values: Floats, positive: NDArray[np.bool_]) -> float:
    """Area under the ROC curve by asking every pair."""
    above = values[positive][:, None] - values[~positive][None, :]
    return float(((above > 0) + 0.5 * (above == 0)).mean())
