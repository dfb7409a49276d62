"""Scores in plain numpy and scipy, as docs/scores.md defines them."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray
from scipy import integrate, stats

from prf.results.occupancy import OccupancyGrid
from tests.reference import slow_sonar
from tests.reference.slow_sonar import Cone, Ring

Floats = NDArray[np.float64]


def grid_density(
    grid: OccupancyGrid,
    origin: Floats,
    angle: float,
    readings: Floats,
    noise: float,
    outlier: float,
    limit: float,
    reach: float,
) -> tuple[Floats, float]:
    """Density of readings of one beam, and the mass of those beyond its reach: a sum over bins, blur by quadrature."""
    density = np.full(len(readings), outlier / limit)
    unmet, mass = 1.0, outlier * (1.0 - reach / limit)
    for near in np.arange(0.0, reach - 1e-9, 0.1):
        far = min(near + 0.1, reach)
        middle = 0.5 * (near + far)
        place = origin + middle * np.array([np.cos(angle), np.sin(angle)])
        column, row = np.floor((place - grid.origin) / grid.resolution).astype(int)
        p = float(grid.occupancy[row, column])
        blur = [
            integrate.quad(lambda d, r=r: stats.norm.pdf(r, d, noise), near, far, points=(middle,))[0] for r in readings
        ]
        total = integrate.quad(lambda d: stats.norm.cdf(d / noise), near, far)[0]
        beyond = integrate.quad(lambda d: stats.norm.cdf((d - reach) / noise), near, far)[0]
        density += (1.0 - outlier) * p * unmet * np.array(blur) / total
        mass += (1.0 - outlier) * p * unmet * beyond / total
        unmet *= 1.0 - p
    return density, mass + (1.0 - outlier) * unmet


def arc_probability(grid: OccupancyGrid, at: Cone, radius: float) -> float:
    """1 - prod (1 - p) over the cells that the arc of a cone passes, in steps of at most half a cell."""
    n = max(1, math.ceil(at.view * radius / (0.5 * grid.resolution)))
    turn = at.angle - 0.5 * at.view + at.view * (np.arange(n) + 0.5) / n
    place = np.array([at.x, at.y]) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cells = np.floor((place - grid.origin) / grid.resolution).astype(int).tolist()
    free = 1.0
    for (column, row), _ in itertools.groupby(cells):
        known = 0 <= row < grid.occupancy.shape[0] and 0 <= column < grid.occupancy.shape[1]
        free *= 1.0 - (float(grid.occupancy[row, column]) if known else 0.5)
    return 1.0 - free


def cone_density(grid: OccupancyGrid, at: Cone, ring: Ring, readings: Floats) -> tuple[Floats, float]:
    """Density of sonar readings by first hits among cells, and the mass of no return; the blur by quadrature."""
    stray = 1.0 / (1.0 + math.exp(ring.surface[0]))
    density, mass, unmet = np.zeros(len(readings)), 0.0, 1.0
    for near in np.arange(0.0, ring.max - 1e-9, 0.1):
        far = min(near + 0.1, ring.max)
        s, p = ring.spread(0.5 * (near + far)), arc_probability(grid, at, 0.5 * (near + far))
        blur = [integrate.quad(lambda d, r=r, s=s: stats.norm.pdf(r, d, s), near, far)[0] for r in readings]
        total = integrate.quad(lambda d, s=s: stats.norm.cdf(d / s), near, far)[0]
        beyond = integrate.quad(lambda d, s=s: stats.norm.sf((ring.max - d) / s), near, far)[0]
        density += p * unmet * np.array(blur) / total
        mass += p * unmet * beyond / total
        unmet *= 1.0 - p
    rest = (1.0 - stray) * unmet + stray
    return (
        (1.0 - stray) * density + rest * slow_sonar.density(ring, [], readings),
        (1.0 - stray) * mass + rest * slow_sonar.mass_of_no_return(ring, []),
    )


def pair_count_area(values: Floats, positive: NDArray[np.bool_]) -> float:
    """Area under the ROC curve by asking every pair."""
    above = values[positive][:, None] - values[~positive][None, :]
    return float(((above > 0) + 0.5 * (above == 0)).mean())
